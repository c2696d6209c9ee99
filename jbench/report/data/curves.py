"""Learning curves across seeds, in the two orders of the paper's figures, and the paper's own."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.lib.stride_tricks import sliding_window_view

from jbench.array_types import FloatArray, IntArray
from jbench.names import Order, ReturnsName
from jbench.report.data.source_names import PUBLISHED
from jbench.representation_names import FULL, shown_representation
from jbench.returns import averaged_points, mean_over_run
from jbench.task_specs import episode_steps

QUANTILES = (10, 25, 50, 75, 90)  # percent, across seeds
SEQUENCE = "augmented SAC"  # the authors' curve of SAC on augmented robots in sequence

QUANTILE_COLUMNS = ("q10", "q25", "median", "q75", "q90")
"""What frames call the `QUANTILES`."""

PUBLISHED_KEY = ["figure", "task", "algo", "representation"]
"""Columns that name a published curve."""

_TRAINED_AS = {
    "Figure 7": {FULL: "raw", "dae12": "dae12-script"},
    "Figure 8": {
        FULL: "raw-without-speed_in_target_frame",
        "dae12": "dae12-without-speed_in_target_frame-script",
    },
}
"""By figure and published name: the representations of agents that observe the same here.

The agents of Figures 7 and 8 observed SI units; `jbench sweep fig7` and `fig8` train them."""


class Curve(NamedTuple):
    """Quantiles of the return across seeds, one point per window.

    Each point is of every seed. Windows are centered on their points, from the first one to the
    last one. At the two ends, windows are cut off, down to half of their width.
    """

    order: Order
    window: int
    control_steps: FloatArray  # (points,) center of each window, over all environments
    seeds: int  # number that every point is of
    quantiles: FloatArray  # (5, points) returns, a row for each of `QUANTILES`
    widths: IntArray  # (points,) episodes averaged in each point: `window`, or fewer at the ends
    by_seed: Sequence["SeedCurve"] = ()  # the curve of each seed, up to its own end

    def quantile(self, percent: int) -> FloatArray:
        """Returns one of the `QUANTILES`, (points,)."""
        row: FloatArray = self.quantiles[QUANTILES.index(percent)]
        return row


class SeedCurve(NamedTuple):
    """The smoothed curve of one seed, at the control steps at which it was logged.

    A seed that ends before or after the others keeps all of its points.
    """

    control_steps: FloatArray  # (points,) center of each window
    values: FloatArray  # (points,) mean return over the window
    widths: IntArray  # (points,) episodes averaged in each point
    window: int


def learning_curve(
    returns: FloatArray, control_steps: FloatArray, order: Order, window: int
) -> Curve:
    """Aggregates returns (seeds, points) at control steps (points,) that all seeds have in common.

    Args:
        order: of quantiles and smoothing; see `jbench.names.ORDERS`.
        window: episodes to average, but at most a quarter of the points.
    """
    points = len(control_steps)
    if not points:
        nothing = np.empty((len(QUANTILES), 0))
        return Curve(order, 1, control_steps, len(returns), nothing, np.empty(0, np.int64))

    window = _window(points, window)
    if order == "quantile-first":
        quantiles = sliding_average(quantiles_across_seeds(returns), window)
    else:
        quantiles = quantiles_across_seeds(sliding_average(returns, window))

    middles = centers(control_steps, window)
    return Curve(order, window, middles, len(returns), quantiles, _widths(points, window))


def seed_curve(returns: FloatArray, control_steps: FloatArray, window: int) -> SeedCurve:
    """Smooths the returns (points,) of one seed, which may be NaN; see `learning_curve`."""
    window = _window(len(returns), window)
    values = sliding_average(returns, window)
    steps = centers(control_steps, window)
    widths = _widths(len(returns), window)
    known = np.isfinite(values)
    return SeedCurve(steps[known], values[known], widths[known], window)


def _window(points: int, most: int) -> int:
    """Returns how many points are averaged: at most a quarter of them."""
    return min(most, max(1, points // 4))


def _widths(points: int, window: int) -> IntArray:
    """Returns the number of points in each window of `sliding_average`."""
    first = np.arange(points + 2 * (window // 2) - window + 1) - window // 2
    last = np.minimum(first + window, points) - 1
    return np.asarray(last + 1 - np.maximum(first, 0), np.int64)


def moving_average(values: FloatArray, window: int) -> FloatArray:
    """Returns the mean of values (..., episodes) over each full window, ignoring NaN.

    There are (..., episodes - window + 1); NaN if a window, of 1 to `episodes`, contains only NaN.
    """
    present = np.isfinite(values)
    # A running sum would be faster, but would leave rounding errors where returns are 0.
    sums = sliding_window_view(np.where(present, values, 0.0), window, axis=-1).sum(axis=-1)
    ends = np.cumsum(present, axis=-1)
    counts = ends[..., window - 1 :].copy()
    counts[..., 1:] -= ends[..., :-window]
    means: FloatArray = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    return means


def sliding_average(values: FloatArray, window: int) -> FloatArray:
    """Returns the mean of values (..., episodes) over each centered window, cut off at the ends.

    There are (..., points), one per episode, and one more if the window is even; NaN if a window,
    of 1 to `episodes`, contains only NaN.
    """
    outside = np.full((*values.shape[:-1], window // 2), np.nan)
    return moving_average(np.concatenate([outside, values, outside], axis=-1), window)


def centers(values: FloatArray, window: int) -> FloatArray:
    """Returns the value at the center of each window of `sliding_average`, (points,).

    For a whole window this is the mean. For a cut-off window it is the interpolated value at the
    center of the whole window, clamped to the first and last of the ascending values (episodes,).
    """
    cut = window // 2
    middles = np.arange(cut) - cut + (window - 1) / 2
    index = np.arange(len(values))
    before = np.interp(middles, index, values)
    after = np.interp(len(values) - 1 - middles[::-1], index, values)
    return np.concatenate([before, moving_average(values, window), after])


def quantiles_across_seeds(values: FloatArray) -> FloatArray:
    """Returns the `QUANTILES` (5, columns) of values (seeds, columns), by numpy's linear method."""
    return np.asarray(np.percentile(values, QUANTILES, axis=0), np.float64)


def final_returns(
    returns: FloatArray, control_steps: FloatArray, lengths: IntArray, kind: ReturnsName
) -> FloatArray:
    """Returns final returns, and the mean control step, deviation and number of points, (4, seeds).

    A final return is that of `jbench.returns`; NaN for a seed without one. Its deviation (of n - 1)
    and number are those of the finite points that it averages.

    Args:
        returns: (seeds, points) returns; NaN after a run's end, or if not finite.
        control_steps: (seeds, points) control steps at each point; NaN after the run's end.
        lengths: (seeds,) number of points of each run.
        kind: of the returns.
    """
    rows = []
    last = averaged_points(lengths, kind)
    for end, count, *points in zip(lengths, last, returns, control_steps, strict=True):
        achieved, steps = (values[end - count : end] for values in points)
        finite = achieved[np.isfinite(achieved)]
        deviation = np.std(finite, ddof=1) if len(finite) > 1 else np.nan
        means = (mean_over_run(values) for values in (achieved, steps))
        mean, middle = (np.nan if mean is None else mean for mean in means)
        rows.append((mean, middle, deviation, len(finite)))

    return np.array(rows, float).T


def read_published(table: pa.Table) -> pd.DataFrame:
    """Returns the curves of Figures 7, 8 and 9, and of SAC on ten augmented robots in sequence.

    Columns: figure (`Figure 9`, or `SEQUENCE`), task, algo, representation, steps (center of the
    window, as printed), q10, q25, median, q75, q90 (NaN if a figure lacks them), source, seeds.
    Figure 8 with a wider, estimated band is left out.
    """
    rows: pd.DataFrame = table.to_pandas(use_threads=False)
    rows = rows[rows["figure"] != "fig8-10-90"].rename(columns={"control_steps": "steps"})

    point = [*PUBLISHED_KEY, "steps"]
    points = rows.set_index([*point, "quantile"])["episode_return"].unstack()
    points = points.rename(columns=dict(zip(QUANTILES, QUANTILE_COLUMNS, strict=True)))
    points = points.reset_index().rename_axis(columns=None)
    points = points[points["median"].notna()].reindex(columns=[*point, *QUANTILE_COLUMNS])

    is_sequence = points["figure"] == "augmented-sac"
    figure = points["figure"].str.replace("fig", "Figure ").where(~is_sequence, SEQUENCE)
    points = points.assign(
        figure=figure,
        representation=points["representation"].where(~is_sequence, FULL),
        source=PUBLISHED,
        seeds=np.where(figure == "Figure 7", 1, 10),
    )
    return points.astype({"steps": float})


def trained_as(figure: str, representation: str) -> str:
    """Returns the representation with which jbench trains the agents of a published curve."""
    return _TRAINED_AS.get(figure, {}).get(representation, representation)


def beside_which(published: pd.DataFrame, drawn: Collection[str]) -> list[str]:
    """Returns the representation beside which each published point is drawn.

    It is that of `trained_as`, if it is among those that are drawn, else the published one.
    """
    names = []
    for figure, named in zip(published["figure"], published["representation"], strict=True):
        agents = trained_as(figure, named)
        names.append(agents if agents in drawn else named)

    return names


def best_median(
    published: pd.DataFrame, names: Sequence[str], control_steps: float, *, sequence: bool = False
) -> tuple[float, str] | None:
    """Returns the best published median at a control step, and the figure's name.

    Names are those of a task, an algorithm and a representation, which is the published one or that
    of `trained_as`. It is interpolated at the center of a window, on the curve of the plain robot
    or of a sequence of augmented ones. A curve's ends have a tolerance of an episode, because the
    paper's windows are counted from the start of an episode and ours from its end.
    """
    task, algo, representation = names
    length = episode_steps(task)
    if length is None:  # the paper has curves of the Jitterbug only
        return None

    ours = shown_representation(representation)
    published = published[(published["task"] == task) & (published["algo"] == algo)]
    medians = []
    for named, curve in published.groupby(["figure", "representation"]):
        figure, theirs = map(str, named)
        if ours not in (theirs, trained_as(figure, theirs)):
            continue

        steps, median = curve[["steps", "median"]].to_numpy().T
        within = steps[0] - length <= control_steps <= steps[-1] + length
        if within and sequence == (figure == SEQUENCE):
            medians.append((float(np.interp(control_steps, steps, median)), figure))

    return max(medians, default=None)
