"""Scores of each seed of a cell, and their statistics across seeds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report.analysis import statistics as st
from jbench.report.analysis.agents import Agents
from jbench.report.data.cells import IMPORTED, SOLVED, Cell, LearnedCurve
from jbench.report.data.curves import (
    FloatArray,
    IntArray,
    final_returns,
    moving_average,
    steps_to_threshold,
)
from jbench.report.data.published import PublishedCurve, best_at_end
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.returns import final_episodes

SPREADS = {
    "interquartile_range": st.interquartile_range,
    "standard_deviation": st.standard_deviation,
    "ten_to_ninety": st.ten_to_ninety,
}
"""Statistics of the spread between seeds."""

BY_EPISODES = "standard_deviation_by_episodes"
"""Standard deviation that episodes alone would cause; see `Scores.deviation_by_episodes`."""

_LOCATIONS = {"median": st.median, "interquartile_mean": st.interquartile_mean}


class Scores(NamedTuple):
    """Scores of a cell's seeds up to a control step.

    Attributes:
        final: (seeds,) final returns; see `returns.Returns.final`.
        area: (seeds,) mean return over the run.
        variances: (seeds,) variance of each final return if its episodes are independent: the
            sample variance of their returns over their number; NaN if unknown.
        episodes: (seeds,) number of these episodes.
        control_steps: maximum control steps of the scores.
    """

    final: FloatArray
    area: FloatArray
    variances: FloatArray
    episodes: FloatArray
    control_steps: int

    @property
    def deviation_by_episodes(self) -> float:
        """Standard deviation of the final returns if all agents had the same expected return."""
        return float(np.sqrt(np.mean(self.variances))) if len(self.variances) else np.nan

    @property
    def agents(self) -> Agents:
        """The final returns with the variances that are due to their episodes."""
        return Agents(self.final, self.variances, self.episodes)


class Statistic(NamedTuple):
    """A statistic of a cell's seeds.

    Attributes:
        measure: number of each seed: `final_return`, `area`, `steps_to_solved` or
            `steps_to_half_best`.
        statistic: `median`, `interquartile_mean`, one of `SPREADS`, the ratio of one to that of the
            full observation, such as `standard_deviation_ratio`, or `BY_EPISODES`.
        seeds: number of seeds; for a ratio, the smaller number of the two cells.
        reached: number of seeds that reach the threshold; None without a threshold.
        threshold: episode return to reach, or None.
        control_steps: maximum control steps of a seed; for a ratio, common to both cells.
    """

    measure: str
    statistic: str
    estimate: st.Estimate
    seeds: int
    reached: int | None
    threshold: float | None
    control_steps: int


@dataclass(frozen=True)
class Summary:
    """All statistics of a cell.

    Attributes:
        baseline: cell of the full observation for ratios, or None.
    """

    cell: Cell
    statistics: tuple[Statistic, ...]
    baseline: Cell | None

    def get(self, measure: str, statistic: str) -> Statistic | None:
        """Returns one of the statistics, or None."""
        matches = (s for s in self.statistics if (s.measure, s.statistic) == (measure, statistic))
        return next(matches, None)


_SCORES: WeakKeyDictionary[Cell, dict[int | None, Scores]] = WeakKeyDictionary()
"""Scores of the existing cells, which many tables and figures need; a cell never changes."""


def scores_of(cell: Cell, control_steps: int | None = None) -> Scores:
    """Returns the scores of a cell up to a control step; None: over the whole runs."""
    known = _SCORES.setdefault(cell, {})
    if control_steps not in known:
        known[control_steps] = _scores(cell, control_steps)
    return known[control_steps]


def _scores(cell: Cell, control_steps: int | None) -> Scores:
    lengths = cell.lengths_up_to(control_steps)
    if control_steps is None:
        control_steps = int(cell.longest)
    within = np.arange(cell.returns.shape[1]) < lengths[:, None]
    returns = np.where(within, cell.returns, np.nan)
    final = final_returns(returns, cell.control_steps, lengths, cell.kind.final_points)[0]
    counts = np.isfinite(returns).sum(axis=1)
    area = np.divide(
        np.nansum(returns, axis=1), counts, np.full(len(returns), np.nan), where=counts > 0
    )
    known = np.isfinite(final) & np.isfinite(area)
    variances = _variances(cell, returns, lengths)
    episodes = _episodes(cell, lengths)
    return Scores(final[known], area[known], variances[known], episodes[known], control_steps)


def _episodes(cell: Cell, lengths: IntArray) -> FloatArray:
    """Returns the number of episodes (seeds,) of each final return."""
    if cell.kind is EVALUATION:
        planned = cell.settings.evaluate_episodes or np.nan
        return np.full(len(lengths), float(planned))
    return final_episodes(lengths, cell.kind.final_points).astype(np.float64)


def _variances(cell: Cell, returns: FloatArray, lengths: IntArray) -> FloatArray:
    """Returns the variances (seeds,) of the final returns; see `Scores`."""
    if cell.kind is EVALUATION:
        return cell.variances[np.arange(len(lengths)), lengths - 1]
    if cell.source == IMPORTED:  # its points need not be episodes
        return np.full(len(lengths), np.nan)
    counts = final_episodes(lengths, cell.kind.final_points)
    ends = [row[end - n : end] for row, end, n in zip(returns, lengths, counts, strict=True)]
    return np.array([_variance_of_mean(values[np.isfinite(values)]) for values in ends])


def _variance_of_mean(values: FloatArray) -> float:
    return float(np.var(values, ddof=1)) / len(values) if len(values) > 1 else np.nan


def compared_scores(*cells: Cell) -> list[Scores]:
    """Returns the scores of cells up to the last control step that each of their seeds reached."""
    common = int(min(cell.last_step for cell in cells))
    return [scores_of(cell, common) for cell in cells]


def final_percentiles(cell: Cell) -> tuple[float, float, float]:
    """Returns the 10th, 50th and 90th percentile of the final returns; NaN if there are none."""
    final = scores_of(cell).final
    if not len(final):
        return np.nan, np.nan, np.nan
    low, median, high = np.percentile(final, (10, 50, 90)).tolist()
    return low, median, high


def baseline_of(cell: Cell, cells: Sequence[Cell]) -> Cell | None:
    """Returns the cell with the full observation and otherwise the same settings, or None."""
    if cell.representation == FULL:
        return None
    return next(
        (
            other
            for other in cells
            if other.representation == FULL
            and (other.source, other.task, other.algo) == (cell.source, cell.task, cell.algo)
            and other.same_but(cell, "representation")
        ),
        None,
    )


def summaries(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve]
) -> list[Summary]:
    """Returns the statistics of each cell, in the same order."""
    cells = [item.cell for item in learned]
    found = []
    for item in learned:
        baseline = baseline_of(item.cell, cells)
        # The published curves are training returns.
        theirs = published if item.cell.kind is TRAINING else ()
        best = best_at_end(theirs, item.cell.task)
        half = None if best is None else best / 2
        statistics = (*_of_runs(item, half), *_ratios(item.cell, baseline))
        found.append(Summary(item.cell, statistics, baseline))
    return found


def statistics_frame(summaries: Sequence[Summary]) -> pd.DataFrame:
    """Returns a row per statistic of each cell with the exact numbers of the tables.

    Columns: returns (kind), source, task, algo, representation, variant, settings, measure,
    statistic, value, low, high (ends of the 95% interval), interval (name of the interval), seeds,
    reached (number of seeds that reach the threshold), threshold (return), control_steps (maximum),
    compared_with (variant of the full observation's cell, for ratios). An infinite number of steps
    means after the runs' end.
    """
    rows = [
        {
            "returns": summary.cell.kind.name,
            "source": summary.cell.source,
            "task": summary.cell.task,
            "algo": summary.cell.algo,
            "representation": summary.cell.representation,
            "variant": summary.cell.variant,
            "settings": summary.cell.label,
            "measure": one.measure,
            "statistic": one.statistic,
            "value": one.estimate.value,
            "low": one.estimate.low,
            "high": one.estimate.high,
            "interval": "uncertainty (95% interval)",
            "seeds": one.seeds,
            "reached": one.reached,
            "threshold": one.threshold,
            "control_steps": one.control_steps,
            "compared_with": summary.baseline.variant
            if summary.baseline and one.statistic.endswith("_ratio")
            else None,
        }
        for summary in summaries
        for one in summary.statistics
    ]
    return pd.DataFrame(rows).astype({"reached": "Int64"})


def _of_runs(item: LearnedCurve, half_best: float | None) -> Iterator[Statistic]:
    """Yields locations and spreads; sequences of robots have no number of steps to a return."""
    cell, curve = item
    whole = scores_of(cell)
    # Locations and spreads have the same resamples.
    of_final = _LOCATIONS | (SPREADS if len(whole.final) > 1 else {})
    final = [*_of_seeds("final_return", whole.final, of_final, whole.control_steps)]
    yield from final[: len(_LOCATIONS)]
    yield from _of_seeds("area", whole.area, _LOCATIONS, whole.control_steps)
    thresholds = {"steps_to_solved": float(SOLVED), "steps_to_half_best": half_best}
    for measure, threshold in thresholds.items():
        if threshold is not None and cell.robots <= 1:
            # Windows that are cut off at the ends of a run, and seeds without returns don't count.
            known = np.isfinite(cell.returns).any(axis=1)
            at = moving_average(cell.control_steps[known], curve.window)
            steps = steps_to_threshold(curve.each[known][:, curve.full], at, threshold)
            yield from _of_seeds(measure, steps, _LOCATIONS, whole.control_steps, threshold)
    yield from final[len(_LOCATIONS) :]
    if np.isfinite(whole.deviation_by_episodes):
        alone = st.Estimate(whole.deviation_by_episodes)
        count = len(whole.final)
        yield Statistic("final_return", BY_EPISODES, alone, count, None, None, whole.control_steps)


def _ratios(cell: Cell, baseline: Cell | None) -> Iterator[Statistic]:
    if baseline is None:
        return
    ours, theirs = compared_scores(cell, baseline)
    seeds = min(len(ours.final), len(theirs.final))
    if seeds < 2:
        return
    ratios = {f"{name}_ratio": st.ratio(spread) for name, spread in SPREADS.items()}
    estimates = st.estimates(list(ratios.values()), [ours.final], [theirs.final])
    for name, estimate in zip(ratios, estimates, strict=True):
        yield Statistic("final_return", name, estimate, seeds, None, None, ours.control_steps)


def _of_seeds(
    measure: str,
    scores: FloatArray,
    statistics: dict[str, st.Statistic],
    control_steps: int,
    threshold: float | None = None,
) -> Iterator[Statistic]:
    reached = None if threshold is None else int(np.isfinite(scores).sum())
    estimates = st.estimates(list(statistics.values()), [scores])
    for name, estimate in zip(statistics, estimates, strict=True):
        yield Statistic(measure, name, estimate, len(scores), reached, threshold, control_steps)
