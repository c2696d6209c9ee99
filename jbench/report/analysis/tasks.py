"""Numbers over several tasks: performance profiles and interquartile means.

Returns of tasks with different ranges are normalized before they are joined: 0 is the lowest and 1
the highest return of a task, over all its runs and points. Tasks of dm_control share a range.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from jbench.names import EPISODE_STEPS
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configuration, concatenated, in_order
from jbench.report.data.returns import FILE
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st

ALL_TASKS, NORMALIZED = "all tasks", "all tasks, normalized"
"""Names of several tasks together, which share a range or do not."""

PROFILES = [*ID, "returns", "seeds", "final_return", "share", "low", "high"]

_THRESHOLDS = 201

Range = tuple[float, float]
"""Lowest and highest return."""


def ranges(configurations: Sequence[Configuration]) -> dict[str, Range]:
    """Returns the range of each task: of a file that of its returns, else 0 to 1000."""
    found: dict[str, Range] = {}
    for one in configurations:
        ends = 0.0, float(EPISODE_STEPS)
        if one.source == FILE:
            ends = float(np.nanmin(one.returns)), float(np.nanmax(one.returns))
        low, high = found.get(one.task, ends)
        found[one.task] = min(low, ends[0]), max(high, ends[1])
    return found


def strata(same: Sequence[FloatArray], tasks: Sequence[Range]) -> tuple[list[FloatArray], Range]:
    """Returns scores that can be joined, and their range: normalized if those of tasks differ.

    Args:
        same: (seeds,) final returns on each task.
        tasks: their ranges.
    """
    if len({*tasks}) == 1:
        return [*same], tasks[0]
    pairs = zip(same, tasks, strict=True)
    return [(one - low) / ((high - low) or 1.0) for one, (low, high) in pairs], (0.0, 1.0)


def together(known: Mapping[str, Range]) -> str:
    """Returns what several tasks together are called."""
    return ALL_TASKS if len({*known.values()}) == 1 else NORMALIZED


def on_all_tasks(configurations: Sequence[Configuration]) -> list[list[Configuration]]:
    """Returns the configurations, by task, that were trained equally long on each of several."""
    groups: dict[tuple[str, int], dict[str, Configuration]] = {}
    known = [one for one in configurations if len(seed_scores(one).final)]
    for one in known:
        # A file has one curve of a method on a task, of any length.
        steps = 0 if one.source == FILE else int(one.steps.max())
        groups.setdefault((one.label, steps), {}).setdefault(one.task, one)
    tasks = in_order(one.task for one in known)
    whole = [same for same in groups.values() if len(same) == len(tasks) > 1]
    return [[same[task] for task in tasks] for same in whole]


def profile_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the share of runs above each return (Agarwal et al., 2021, section 4.2).

    The rows of `together` are of the configurations that were trained on each task; every task has
    the same weight. Columns: `ID`, returns, seeds, final_return, share, low, high (pointwise 95%
    interval, for at least three seeds).

    Args:
        configurations: of one kind of return, in the order of tasks.
    """
    known, parts = ranges(configurations), []
    alone = [one for one in configurations if len(seed_scores(one).final)]
    for same in [*([one] for one in alone), *on_all_tasks(configurations)]:
        finals = [seed_scores(one).final for one in same]
        scores, ends = strata(finals, [known[one.task] for one in same])
        if len(same) == 1 and same[0].source == FILE:
            every = [seed_scores(one).final for one in alone if one.task == same[0].task]
            lowest, highest = np.min(np.concatenate(every)), np.max(np.concatenate(every))
            ends = lowest - 0.02 * ((highest - lowest) or 1), highest
        thresholds = np.linspace(*ends, _THRESHOLDS)
        low = high = np.full(len(thresholds), np.nan)
        if min(map(len, scores)) >= st.MIN_SEEDS:
            low, high = st.profile_interval(scores, thresholds)
        names = {**same[0].identity, "returns": same[0].kind}
        names |= {"task": together(known)} if len(same) > 1 else {}
        numbers = {"seeds": sum(map(len, scores)), "final_return": thresholds}
        numbers |= {"share": st.performance_profile(scores, thresholds)}
        parts.append(pd.DataFrame({**names, **numbers, "low": low, "high": high}))
    return concatenated(parts, PROFILES)


def with_file_means(frame: pd.DataFrame, configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Adds rows to `configuration_frame`: each method of a file on all tasks together.

    Args:
        configurations: of one kind of return.
    """
    known, rows = ranges(configurations), []
    for same in on_all_tasks([one for one in configurations if one.source == FILE]):
        finals = [seed_scores(one).final for one in same]
        scores, _ = strata(finals, [known[one.task] for one in same])
        value, low, high, _ = st.estimate(st.interquartile_mean, scores)
        task, ends = together(known), [steps for one in same for steps in one.steps]
        names = {**same[0].identity, "task": task, "returns": same[0].kind}
        names |= {"configuration": f"{task} {same[0].label}"}
        numbers = {"seeds": sum(map(len, scores)), "iqm": value, "iqm_low": low, "iqm_high": high}
        numbers |= {"draws": 0, "diverged": 0, "steps_min": min(ends), "steps": max(ends)}
        rows.append({**names, **numbers})
    more = pd.DataFrame(rows, columns=frame.columns).astype({"reached": "Int64"})
    return pd.concat([frame, more], ignore_index=True) if rows else frame
