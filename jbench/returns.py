"""The final return of a run, and its mean return, as every command, study and report define them.

A run has points: its training episodes, or the means of its evaluations. Numbers that are not
finite are left out.
"""

import numpy as np
from numpy.typing import NDArray

from jbench.array_types import FloatArray
from jbench.names import ReturnsName
from jbench.task_specs import return_range

EVALUATION: ReturnsName = "evaluation"
"""Mean return of the episodes of an evaluation, in which the policy is deterministic."""

TRAINING: ReturnsName = "training"
"""Return of a training episode, exploration included."""

AVERAGED_EPISODES = 100
"""Maximum number of episodes in a final return: the paper's moving average (Figures 8 and 9)."""


def averaged_points(points: NDArray[np.int64], kind: ReturnsName) -> NDArray[np.int64]:
    """Returns the number of last points (runs,) that final returns average.

    It is 1 for evaluations. For training episodes it is a quarter of them, from 1 to the maximum.
    """
    most = 1 if kind == EVALUATION else AVERAGED_EPISODES
    return np.clip(points // 4, 1, most)


def final_return(points: FloatArray, kind: ReturnsName = TRAINING) -> float | None:
    """Returns the mean of the last points of a run (points,); None if none of them is finite."""
    last = int(averaged_points(np.array(len(points)), kind))
    return mean_over_run(points[-last:])


def mean_over_run(points: FloatArray) -> float | None:
    """Returns the mean of the points of a run (points,); None if none of them is finite."""
    finite = points[np.isfinite(points)]
    if not len(finite):
        return None
    return float(finite.mean())


def diverged_return(training: FloatArray, task: str) -> float | None:
    """Returns what a run on a task that diverged counts with from then on: its final return.

    It is 0, the lowest return of most tasks, or the lowest of its training returns (episodes,) if
    that is negative: on a task whose returns are costs, 0 would be a success. It is None if no
    return is finite and the lowest one of the task is unknown, since 0 might be the best.
    """
    finite = training[np.isfinite(training)]
    if not len(finite) and return_range(task) is None:
        return None
    return float(np.min(finite, initial=0.0))


def last_evaluation_return(evaluations: NDArray[np.int32], returns: FloatArray) -> float | None:
    """Returns the mean return of the last evaluation; None if none of its returns is finite.

    It is the final return of a run's evaluations. Both arguments are of the evaluation episodes
    (episodes,), of which there may be none.
    """
    last = evaluations.max(initial=0)
    return mean_over_run(returns[evaluations == last])


def evaluation_means(evaluations: NDArray[np.int32], returns: FloatArray) -> FloatArray:
    """Returns the mean return (evaluations,) of each evaluation in order; NaN if none is finite.

    Both arguments are of the evaluation episodes (episodes,).
    """
    means = (mean_over_run(returns[evaluations == number]) for number in np.unique(evaluations))
    return np.array([np.nan if mean is None else mean for mean in means], np.float64)
