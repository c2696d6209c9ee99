"""Scores of each seed of a configuration, and their statistics across seeds."""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from jbench.report.analysis import statistics as st
from jbench.report.analysis.agents import Agents, components, smallest_difference
from jbench.report.data.cells import IMPORTED, Cell
from jbench.report.data.curves import (
    BoolArray,
    Curve,
    FloatArray,
    IntArray,
    final_returns,
    moving_average,
    steps_to_threshold,
)
from jbench.report.data.returns import EVALUATION, SOLVED
from jbench.returns import final_episodes


class Scores(NamedTuple):
    """Scores of a configuration's seeds up to a control step.

    Attributes:
        final: (seeds,) final returns; see `returns.Returns.final`.
        area: (seeds,) mean return over the run.
        deviations: (seeds,) standard deviation of the episodes that a final return averages; NaN
            if unknown.
        episodes: (seeds,) their number.
        known: (seeds of the cell,) whether a seed has scores.
        control_steps: maximum control steps of the scores.
    """

    final: FloatArray
    area: FloatArray
    deviations: FloatArray
    episodes: FloatArray
    known: BoolArray
    control_steps: int

    @property
    def deviation_by_episodes(self) -> float:
        """Standard deviation of the final returns if all agents had the same expected return."""
        variances = self.agents.variances
        return float(np.sqrt(np.mean(variances))) if len(variances) else np.nan

    @property
    def agents(self) -> Agents:
        """The final returns with the variances that are due to their episodes."""
        return Agents(self.final, self.deviations**2 / self.episodes, self.episodes)


_SCORES: WeakKeyDictionary[Cell, dict[int | None, Scores]] = WeakKeyDictionary()
"""Scores of the existing cells, which many frames need; a cell never changes."""


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
    deviations, episodes = _episodes(cell, returns, lengths)
    numbers = final[known], area[known], deviations[known], episodes[known]
    return Scores(*numbers, known, control_steps)


def _episodes(cell: Cell, returns: FloatArray, lengths: IntArray) -> tuple[FloatArray, FloatArray]:
    """Returns the standard deviation and the number (seeds,) of the episodes of final returns."""
    if cell.kind is EVALUATION:
        last = np.arange(len(lengths)), lengths - 1
        return cell.deviations[last], cell.counts[last]
    counts = final_episodes(lengths, cell.kind.final_points)
    ends = [row[end - n : end] for row, end, n in zip(returns, lengths, counts, strict=True)]
    ends = [values[np.isfinite(values)] for values in ends]
    episodes = np.array([len(values) for values in ends], float)
    if cell.source == IMPORTED:  # its points need not be episodes
        return np.full(len(lengths), np.nan), episodes
    deviations = [np.std(values, ddof=1) if len(values) > 1 else np.nan for values in ends]
    return np.array(deviations), episodes


def compared_scores(*cells: Cell) -> list[Scores]:
    """Returns the scores of cells up to the last control step that each of their seeds reached."""
    common = int(min(cell.last_step for cell in cells))
    return [scores_of(cell, common) for cell in cells]


def statistics(cell: Cell, curve: Curve) -> dict[str, float]:
    """Returns the statistics of a cell's seeds, with the ends of their 95% intervals.

    Columns: median, iqm (interquartile mean) and deviation (standard deviation) of the final
    returns, over_run (interquartile mean of the mean return over the run), solved_steps (median of
    the control steps to a return of `SOLVED`; infinite: after the runs' end; NaN for a sequence of
    robots), s (standard deviation between agents), each with …_low and …_high;
    deviation_by_episodes, detectable (smallest difference of means that two such configurations
    show), and reached (number of seeds that reach `SOLVED`).
    """
    scores = scores_of(cell)
    location = {"median": st.median, "iqm": st.interquartile_mean}
    spread = {"deviation": st.standard_deviation} if len(scores.final) > 1 else {}
    row = _intervals(location | spread, scores.final)
    row |= _intervals({"over_run": st.interquartile_mean}, scores.area)
    row["deviation_by_episodes"] = scores.deviation_by_episodes
    row |= _between_agents(scores.agents)
    if cell.robots <= 1:
        steps = _steps_to_solved(cell, curve)
        row |= _intervals({"solved_steps": st.median}, steps)
        row["reached"] = int(np.isfinite(steps).sum())
    return row


def _between_agents(agents: Agents) -> dict[str, float]:
    if not agents.known:
        return {}
    found = components(agents)
    detectable = smallest_difference(
        len(agents.means), found.deviation, found.episode_deviation, float(agents.episodes.mean())
    )
    row = {"s": found.deviation, "s_low": found.low, "s_high": found.high}
    return row | {"detectable": detectable}


def _intervals(statistics: dict[str, st.Statistic], scores: FloatArray) -> dict[str, float]:
    row: dict[str, float] = {}
    estimates = st.estimates(list(statistics.values()), [scores])
    for name, one in zip(statistics, estimates, strict=True):
        row |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
    return row


def _steps_to_solved(cell: Cell, curve: Curve) -> FloatArray:
    """Returns the control steps (seeds with a return,) after which each first reaches `SOLVED`.

    Windows that are cut off at the ends of a run do not count.
    """
    known = np.isfinite(cell.returns).any(axis=1)
    at = moving_average(cell.control_steps[known], curve.window)
    return steps_to_threshold(curve.each[known][:, curve.full], at, SOLVED)
