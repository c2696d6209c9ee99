"""Returns of several seeds at the same control steps.

A median over seeds needs the return of every seed at one control step, but seeds may be logged at
different ones. Then each seed is interpolated linearly between its own points. Nothing is known of
a seed before its first and after its last point, so that curves of several seeds begin at the
latest first point and end at the earliest last one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jbench.array_types import BoolArray, FloatArray
from jbench.names import ReturnsName
from jbench.returns import TRAINING

_FINE = 1001
"""Control steps of an equally spaced grid between points that are not equally spaced."""

_MANY = 10
"""Gaps between points, beside which a shorter one at the end changes a mean little."""

SeedPoints = tuple[FloatArray, FloatArray]
"""Ascending control steps (points,), each once, and the mean returns (points,) at them."""


class _Logged(NamedTuple):
    """The points of one seed at which its return is finite."""

    steps: FloatArray  # (points,), ascending
    returns: FloatArray  # (points,)
    seconds: FloatArray  # (points,) of processor time; NaN if it was not recorded


class CommonPoints(NamedTuple):
    """Returns of the seeds that have any, at control steps that all of them have reached."""

    control_steps: FloatArray  # (points,), ascending
    returns: FloatArray  # (seeds, points), all finite
    processor_time: FloatArray  # (seeds, points) in s; NaN if it was not recorded
    known: BoolArray  # (all seeds,): those that have returns
    interpolated: bool  # whether seeds were logged at different control steps


def at_common_steps(
    kind: ReturnsName, returns: FloatArray, control_steps: FloatArray, times: FloatArray
) -> CommonPoints:
    """Returns the points of seeds at common control steps; none if they have none in common.

    Seeds that were logged at the same control steps keep their points. Otherwise evaluations are
    interpolated at the control steps of all evaluations. Training returns are many and vary from
    episode to episode: they are interpolated at equally spaced steps, as many as the seed with most
    points has, so that a moving average covers equally many control steps everywhere.

    Args:
        returns: (seeds, points); NaN after a run's end, or if not finite.
        control_steps: (seeds, points) at each point; NaN after a run's end.
        times: (seeds, points) processor time in s; NaN if it was not recorded.
    """
    finite = np.isfinite(returns) & np.isfinite(control_steps)
    known: BoolArray = np.asarray(finite.any(axis=1))
    seeds = [
        _Logged(control_steps[seed, points], returns[seed, points], times[seed, points])
        for seed, points in enumerate(finite)
        if points.any()
    ]
    if not seeds:
        nothing = np.empty((0, 0))
        return CommonPoints(np.empty(0), nothing, nothing, known, False)

    first = max(seed.steps[0] for seed in seeds)
    last = min(seed.steps[-1] for seed in seeds)
    shared = [_between(seed, first, last) for seed in seeds]
    steps = shared[0].steps
    if first <= last and all(np.array_equal(seed.steps, steps) for seed in shared):
        values = np.array([seed.returns for seed in shared])
        seconds = np.array([seed.seconds for seed in shared])
        return CommonPoints(steps, values, seconds, known, False)

    if first > last:
        grid = np.empty(0)
    elif kind == TRAINING:
        most = max(len(seed.steps) for seed in shared)
        grid = np.linspace(first, last, max(2, most))
    else:
        grid = np.unique(np.concatenate([seed.steps for seed in shared]))

    values = np.array([interpolated(distinct(seed.steps, seed.returns), grid) for seed in seeds])
    seconds = np.array([interpolated(distinct(seed.steps, seed.seconds), grid) for seed in seeds])
    return CommonPoints(grid, values, seconds, known, True)


def _between(seed: _Logged, first: float, last: float) -> _Logged:
    """Returns the points of a seed from one control step to another one, both included."""
    inside = (seed.steps >= first) & (seed.steps <= last)
    return _Logged(seed.steps[inside], seed.returns[inside], seed.seconds[inside])


def distinct(control_steps: FloatArray, values: FloatArray) -> SeedPoints:
    """Returns each control step once, with the mean of the values there.

    Episodes of several environments may end at one control step.
    """
    steps, places = np.unique(control_steps, return_inverse=True)
    return steps, np.bincount(places, values) / np.bincount(places)


def interpolated(points: SeedPoints, control_steps: FloatArray) -> FloatArray:
    """Returns the values at control steps, none of which is before the first or after the last."""
    return np.asarray(np.interp(control_steps, *points), np.float64)


def means_over_run(
    seeds: Sequence[SeedPoints], beside: Sequence[Sequence[SeedPoints]] = ()
) -> FloatArray:
    """Returns the mean return (seeds,) over the control steps that all of some seeds have reached.

    If all are logged at the same, equally spaced steps, this is the mean of their points. Otherwise
    it is the mean of each seed's interpolated curve at 1,001 equally spaced steps: a mean of points
    would count a part of a run more in which more points were logged. Seeds that have no step in
    common have means over their own steps.

    Args:
        seeds: the points of each; a seed without points has the mean NaN.
        beside: those of other configurations, with whose means these are compared. All of them
            begin at the same step.
    """
    means = np.full(len(seeds), np.nan)
    mine = [(place, points) for place, points in enumerate(seeds) if len(points[0])]
    if not mine:
        return means

    theirs = [steps for group in beside for steps, _ in group if len(steps)]
    ours = [steps for _, (steps, _) in mine]
    if _are_alike([*ours, *theirs]) and len({len(steps) for steps in ours}) == 1:
        for place, (_, returns) in mine:
            means[place] = returns.mean()
        return means

    first = max(steps[0] for steps in ours)
    last = min(steps[-1] for steps in ours)
    latest = max([first, *(steps[0] for steps in theirs)])
    first = latest if latest <= last else first
    for place, points in mine:
        steps, _ = points
        ends = (first, last) if first <= last else (steps[0], steps[-1])
        means[place] = interpolated(points, np.linspace(*ends, _FINE)).mean()

    return means


def _are_alike(logged: Sequence[FloatArray]) -> bool:
    """Returns whether seeds were logged at the same, equally spaced steps, up to their ends."""
    longest = max(logged, key=len)
    gaps = np.diff(longest)
    if len(gaps) >= _MANY and gaps[-1] < gaps[0]:
        gaps = gaps[:-1]  # the evaluation at the end of training, a little after a regular one
    equally_spaced = np.allclose(gaps, gaps[:1], rtol=1e-6)
    return bool(equally_spaced) and all(
        np.array_equal(steps, longest[: len(steps)]) for steps in logged
    )
