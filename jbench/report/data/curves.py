"""Learning curves across seeds, in the two orders of the paper's figures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.names import Order
from jbench.returns import FINAL_EPISODES, final_episodes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

QUANTILES = (10, 25, 50, 75, 90)
"""Percent, across seeds."""

WINDOW = 100
"""Episodes in a moving average (paper, Figures 8 and 9)."""


@dataclass(frozen=True)
class Curve:
    """Quantiles of the return across seeds, one point for each window.

    Windows are centred on their points, from the first episode to the last one. Near the two ends
    of a run the part of a window that lies beyond is cut off: at an end, half of it is left.

    Attributes:
        order: which of the two orders made it.
        window: episodes averaged in a point, but for the ends.
        control_steps: (points,) centre of each window, all environments.
        seeds: (points,) seeds that went through the whole window and have a return in it.
        quantiles: (5, points) returns, a row for each of `QUANTILES`.
        each: (seeds of the cell, points) mean return of each seed over the window; NaN where it
            has not gone through all of it.
        widths: (points,) episodes averaged in each point: `window`, or less at the ends.
    """

    order: Order
    window: int
    control_steps: FloatArray
    seeds: IntArray
    quantiles: FloatArray
    each: FloatArray
    widths: IntArray

    def quantile(self, percent: int) -> FloatArray:
        """Returns one of the `QUANTILES`, (points,)."""
        row: FloatArray = self.quantiles[QUANTILES.index(percent)]
        return row

    @property
    def full(self) -> BoolArray:
        """Which points average a whole window, (points,)."""
        whole: BoolArray = self.widths == self.window
        return whole


def learning_curve(
    returns: FloatArray,
    control_steps: FloatArray,
    lengths: IntArray,
    order: Order = "quantile-first",
    window: int = WINDOW,
) -> Curve:
    """Aggregates the runs of one cell, a run for each seed.

    Args:
        returns: (seeds, episodes) returns; NaN past a run's end, and where there is none.
        control_steps: (seeds, episodes) of the run at each episode's end; NaN past its end.
        lengths: (seeds,) episodes of each run.
        order: see `jbench.names.ORDERS`.
        window: episodes to average; see `fitting_window` for what short runs get instead.
    """
    window = fitting_window(lengths, window)
    episodes = returns.shape[1]
    first = np.arange(episodes + 2 * (window // 2) - window + 1) - window // 2
    last = np.minimum(first + window, episodes) - 1
    # A run that ended has no window past its end, though part of one has returns.
    each = np.where(last >= lengths[:, None], np.nan, sliding_average(returns, window))
    if order == "quantile-first":
        quantiles = sliding_average(quantiles_across_seeds(returns), window)
    else:
        quantiles = quantiles_across_seeds(each)
    return Curve(
        order=order,
        window=window,
        control_steps=centres(np.nanmean(control_steps, axis=0), window),
        seeds=np.sum(np.isfinite(each), axis=0),
        quantiles=quantiles,
        each=each,
        widths=last + 1 - np.maximum(first, 0),
    )


def fitting_window(lengths: IntArray, window: int) -> int:
    """Returns the window, or a quarter of the longest run where that has less than four of it.

    Not of the shortest: a seed that has just begun would tear the smooth curve of the others.
    """
    longest = int(lengths.max())
    return window if longest >= 4 * window else max(1, longest // 4)


def moving_average(values: FloatArray, window: int) -> FloatArray:
    """Returns the mean over each full window of the last axis, NaN left out.

    Args:
        values: (..., episodes).
        window: at least 1 and at most `episodes`.

    Returns:
        (..., episodes - window + 1); NaN where a window holds nothing else.
    """
    there = np.isfinite(values)
    if there.all():
        return _window_sums(values, window) / window
    sums = _window_sums(np.where(there, values, 0.0), window)
    counts = _window_sums(there.astype(np.float64), window)
    means: FloatArray = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    return means


def sliding_average(values: FloatArray, window: int) -> FloatArray:
    """Returns the mean over each centred window of the last axis, cut off at its ends.

    Args:
        values: (..., episodes).
        window: at least 1 and at most `episodes`.

    Returns:
        (..., points), one for each episode, and one more if the window is even; NaN where a
        window holds nothing else.
    """
    outside = np.full((*values.shape[:-1], window // 2), np.nan)
    return moving_average(np.concatenate([outside, values, outside], axis=-1), window)


def centres(values: FloatArray, window: int) -> FloatArray:
    """Returns the value at the centre of each window of `sliding_average`, (points,).

    Of a whole window that is the mean; of one that is cut off, the value in the middle of the
    whole one, which is not before the first episode and not after the last.

    Args:
        values: (episodes,) rising.
        window: at least 1 and at most `episodes`.
    """
    cut = window // 2
    middles = np.arange(cut) - cut + (window - 1) / 2
    index = np.arange(len(values))
    before = np.interp(middles, index, values)
    after = np.interp(len(values) - 1 - middles[::-1], index, values)
    return np.concatenate([before, moving_average(values, window), after])


def _window_sums(values: FloatArray, window: int) -> FloatArray:
    """Returns the sum over each full window of the last axis.

    Sums of 1, 2, 4, … values are added up to the window. A running sum would be as quick, but leave
    rounding errors where returns are 0.
    """
    count = values.shape[-1] - window + 1
    total: FloatArray | None = None
    size, start, doubled = 1, 0, values
    while start < window:
        if window & size:
            part = doubled[..., start : start + count]
            total = part.copy() if total is None else total + part
            start += size
        if start < window:
            doubled = doubled[..., :-size] + doubled[..., size:]
            size *= 2
    assert total is not None
    return total


def quantiles_across_seeds(values: FloatArray) -> FloatArray:
    """Returns the `QUANTILES` of each column by numpy's linear method, NaN left out.

    Args:
        values: (seeds, columns).

    Returns:
        (5, columns); NaN where a column holds nothing else.
    """
    ordered = np.sort(values, axis=0)  # puts NaN last
    counts = np.isfinite(values).sum(axis=0)
    result = np.full((len(QUANTILES), values.shape[1]), np.nan)
    # Columns with the same number of seeds go together: np.nanquantile goes one by one.
    for count in np.unique(counts[counts > 0]):
        columns = counts == count
        result[:, columns] = np.percentile(ordered[:count, columns], QUANTILES, axis=0)
    return result


def final_returns(
    returns: FloatArray,
    control_steps: FloatArray,
    lengths: IntArray,
    most: int = FINAL_EPISODES,
) -> tuple[FloatArray, FloatArray]:
    """Returns each seed's mean return at its end, and the control steps that it stands for.

    The end of a run is its last quarter, and no more than its last `most` points.

    Args:
        returns: (seeds, points) returns, as for `learning_curve`.
        control_steps: (seeds, points) of the run at each point.
        lengths: (seeds,) points of each run.
        most: points; see `returns.Returns.final_points`.

    Returns:
        Final returns (seeds,), NaN for a seed without any return there; and the centres of the
        points that they are the mean of, in control steps (seeds,).
    """
    last = final_episodes(lengths, most)
    points = np.arange(returns.shape[1])
    end = (points < lengths[:, None]) & (points >= (lengths - last)[:, None])
    width = returns.shape[1]
    means = moving_average(np.where(end, returns, np.nan), width)[:, 0]
    centres = moving_average(np.where(end, control_steps, np.nan), width)[:, 0]
    return means, centres
