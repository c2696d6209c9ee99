"""Performance profiles: the share of runs above each return."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.report.analysis.all_tasks import Range, on_all_tasks, ranges, strata, together
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configuration
from jbench.report.data.points import Part, long_frame
from jbench.report.data.source_names import FILE
from jbench.statistics import bootstrap as st

PROFILES = [*ID, "seeds", "final_return", "share", "low", "high"]

_POINTS = 201
"""Returns at which a profile is computed."""


def profile_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the share of runs above each return (Agarwal et al., 2021, section 4.2).

    The rows of `together` are of the configurations that were trained on each task; every task has
    the same weight. The ends are those of pointwise 95% intervals, for at least three seeds.
    Configurations are of one kind of return, in the order of tasks.
    """
    known = ranges(configurations)
    finals = {config: seed_scores(config).final for config in configurations}
    alone = [config for config, final in finals.items() if len(final)]
    parts: list[Part] = []
    for group in [[config] for config in alone] + on_all_tasks(configurations):
        first = group[0]
        scores, bounds = strata(
            [finals[config] for config in group], [known[config.task] for config in group]
        )
        names: dict[str, Any] = {**first.identity, "seeds": sum(map(len, scores))}
        if len(group) > 1:
            names["task"] = together(known)

        if len(group) == 1 and first.source == FILE:
            shown = _ends_of_file([finals[config] for config in alone if config.task == first.task])
        else:
            shown = _ends(scores, bounds)
        parts.append((names, _profile(scores, np.linspace(*shown, _POINTS))))

    return long_frame(parts, PROFILES)


def _profile(scores: Sequence[FloatArray], thresholds: FloatArray) -> dict[str, FloatArray]:
    """Returns the columns of a profile, each (thresholds,), from the scores of each task."""
    low = high = np.full(len(thresholds), np.nan)
    if min(map(len, scores)) >= st.MIN_SEEDS:
        low, high = st.profile_interval(scores, thresholds)

    return {
        "final_return": thresholds,
        "low": low,
        "high": high,
        "share": st.performance_profile(scores, thresholds),
    }


def _ends(scores: Sequence[FloatArray], bounds: Range) -> Range:
    """Returns where a profile begins and ends: at the bounds, or at scores beyond them."""
    every = np.concatenate(scores)
    return min(bounds[0], every.min()), max(bounds[1], every.max())


def _ends_of_file(finals: Sequence[FloatArray]) -> Range:
    """Returns where the profiles of all methods of a file on a task begin and end."""
    every = np.concatenate(finals)
    width = (every.max() - every.min()) or 1
    return every.min() - 0.02 * width, every.max()
