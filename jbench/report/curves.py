"""Learning curves across seeds, in the two orders of the paper's figures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.names import Order

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

QUANTILES = (10, 25, 50, 75, 90)
"""Percent, across seeds."""

WINDOW = 100
"""Episodes in a moving average (paper, Figures 8 and 9)."""

FINAL_EPISODES = 100
"""Episodes at the end of a run, at most, whose mean is its final return."""


@dataclass(frozen=True)
class Curve:
    """Quantiles of the episode return across seeds, one point for each full window.

    Attributes:
        order: which of the two orders made it.
        window: episodes averaged in a point.
        control_steps: (points,) centre of each window, all environments.
        seeds: (points,) seeds that went through the whole window and have a return in it.
        quantiles: (5, points) episode return, a row for each of `QUANTILES`.
        each: (seeds of the cell, points) mean return of each seed over the window; NaN where it
            has not gone through all of it.
    """

    order: Order
    window: int
    control_steps: FloatArray
    seeds: IntArray
    quantiles: FloatArray
    each: FloatArray

    def quantile(self, percent: int) -> FloatArray:
        """Returns one of the `QUANTILES`, (points,)."""
        row: FloatArray = self.quantiles[QUANTILES.index(percent)]
        return row


def learning_curve(
    returns: FloatArray,
    control_steps: FloatArray,
    lengths: IntArray,
    order: Order = "quantile-first",
    window: int = WINDOW,
) -> Curve:
    """Aggregates the runs of one cell, a run for each seed.

    Args:
        returns: (seeds, episodes) episode returns; NaN past a run's end, and where there is none.
        control_steps: (seeds, episodes) of the run at each episode's end; NaN past its end.
        lengths: (seeds,) episodes of each run.
        order: see `jbench.names.ORDERS`.
        window: episodes to average; see `fitting_window` for what short runs get instead.
    """
    window = fitting_window(lengths, window)
    # A run that ended has no full window past its end, though part of one has returns.
    past_end = np.arange(window - 1, returns.shape[1]) >= lengths[:, None]
    each = np.where(past_end, np.nan, moving_average(returns, window))
    if order == "quantile-first":
        quantiles = moving_average(quantiles_across_seeds(returns), window)
    else:
        quantiles = quantiles_across_seeds(each)
    return Curve(
        order=order,
        window=window,
        control_steps=moving_average(np.nanmean(control_steps, axis=0), window),
        seeds=np.sum(np.isfinite(each), axis=0),
        quantiles=quantiles,
        each=each,
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
    returns: FloatArray, control_steps: FloatArray, lengths: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Returns each seed's mean return at its end, and the control steps that it stands for.

    The end of a run is its last 100 episodes, or its last quarter where that is shorter.

    Args:
        returns: (seeds, episodes) episode returns, as for `learning_curve`.
        control_steps: (seeds, episodes) of the run at each episode's end.
        lengths: (seeds,) episodes of each run.

    Returns:
        Final returns (seeds,), NaN for a seed without any return there; and the centres of the
        episodes that they are the mean of, in control steps (seeds,).
    """
    last = np.clip(lengths // 4, 1, FINAL_EPISODES)
    episodes = np.arange(returns.shape[1])
    end = (episodes < lengths[:, None]) & (episodes >= (lengths - last)[:, None])
    width = returns.shape[1]
    means = moving_average(np.where(end, returns, np.nan), width)[:, 0]
    centres = moving_average(np.where(end, control_steps, np.nan), width)[:, 0]
    return means, centres
