"""Scores of each seed of a configuration, up to a control step."""

from collections.abc import Sequence

import numpy as np

from jbench.array_types import FloatArray
from jbench.report.data.common_steps import means_over_run
from jbench.report.data.configuration import Configuration
from jbench.report.data.curves import final_returns
from jbench.report.data.scores import Scores
from jbench.report.data.source_names import FILE, IMPORTED
from jbench.returns import EVALUATION


def seed_scores(configuration: Configuration, control_steps: int | None = None) -> Scores:
    """Returns the scores up to a control step; None: over the whole runs.

    They are computed once, and kept by the configuration.
    """
    if control_steps not in configuration.scores:
        configuration.scores[control_steps] = _computed(configuration, control_steps)
    return configuration.scores[control_steps]


def _computed(configuration: Configuration, control_steps: int | None) -> Scores:
    """Returns what `seed_scores` keeps."""
    end = configuration.longest if control_steps is None else control_steps
    lengths = configuration.lengths_up_to(end)
    within = np.arange(configuration.returns.shape[1]) < lengths[:, None]
    returns = np.where(within, configuration.returns, np.nan)

    final, middles, deviations, episodes = final_returns(
        returns, configuration.control_steps, lengths, configuration.returns_name
    )
    if configuration.returns_name == EVALUATION:
        last = np.arange(len(lengths)), lengths - 1
        deviations = configuration.deviations[last]
        episodes = configuration.counts[last]
    elif configuration.source in (IMPORTED, FILE):  # whose points need not be episodes
        deviations = np.full(len(final), np.nan)

    # Also if there is no point after it, or the mean of the last points has some before it.
    has_diverged = configuration.diverged_at <= end
    if control_steps is None:
        has_diverged = configuration.diverged
    final = np.where(has_diverged, configuration.diverged_returns, final)
    deviations = np.where(has_diverged, 0.0, deviations)
    episodes = np.where(has_diverged, np.maximum(episodes, 1), episodes)

    area = mean_returns(configuration, configuration.beside, end)
    usable = np.isfinite(final) & np.isfinite(area)
    return Scores(
        final=final[usable],
        area=area[usable],
        deviations=deviations[usable],
        episodes=episodes[usable],
        known=usable,
        middle=float(np.median(middles)),
    )


def mean_returns(
    configuration: Configuration, beside: Sequence[Configuration], control_steps: float
) -> FloatArray:
    """Returns each seed's mean return (seeds,) up to a control step.

    It compares with those of the configurations beside it, however their returns were logged.
    """
    others = [other.points_up_to(control_steps) for other in beside]
    return means_over_run(configuration.points_up_to(control_steps), others)
