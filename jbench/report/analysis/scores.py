"""What the seeds of a cell came to: numbers for each seed, and statistics of them across seeds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report.analysis import statistics as st
from jbench.report.data.cells import SOLVED, Cell, LearnedCurve
from jbench.report.data.curves import FloatArray, final_returns
from jbench.report.data.published import PublishedCurve, best_at_end
from jbench.report.data.returns import TRAINING

UNCERTAINTY = "uncertainty (95% interval)"
"""What the ends of an interval are called wherever one stands."""

SPREADS = {
    "interquartile_range": st.interquartile_range,
    "standard_deviation": st.standard_deviation,
    "ten_to_ninety": st.ten_to_ninety,
}
"""How seeds differ from each other: the statistics of spread."""

_LOCATIONS = {"median": st.median, "interquartile_mean": st.interquartile_mean}


class Scores(NamedTuple):
    """What the seeds of a cell came to, up to the same control step as those compared with it.

    Attributes:
        task: what was learned.
        algo: by which algorithm.
        representation: `full`, or an encoder's kind and size.
        label: the settings that set the cell apart from its variants; may be empty.
        final: (seeds,) final returns; see `returns.Returns.final`.
        area: (seeds,) mean return over the whole run.
        control_steps: up to which these are, at most.
    """

    task: str
    algo: str
    representation: str
    label: str
    final: FloatArray
    area: FloatArray
    control_steps: int

    @property
    def name(self) -> str:
        """Names the cell for a reader."""
        return " ".join(filter(None, (self.task, self.algo, self.representation, self.label)))


class Statistic(NamedTuple):
    """A statistic of a cell's seeds.

    Attributes:
        measure: what each seed has: `final_return`, `area`, `steps_to_solved` or
            `steps_to_half_best`.
        statistic: of them: `median`, `interquartile_mean`, one of `SPREADS`, or such a one as a
            multiple of the full observation's: `standard_deviation_ratio`.
        estimate: with its interval.
        seeds: that it is of; of a ratio, the fewer of both cells.
        reached: seeds that reach the threshold; None where there is none.
        threshold: episode return to reach, or None.
        control_steps: that it is from, the most of a seed; both cells' seeds have them, in a
            ratio.
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
        cell: whose.
        statistics: see `Statistic`.
        baseline: the cell of the full observation that it is compared with, or None.
    """

    cell: Cell
    statistics: tuple[Statistic, ...]
    baseline: Cell | None

    def get(self, measure: str, statistic: str) -> Statistic | None:
        """Returns one of the statistics, or None where there is none."""
        found = (s for s in self.statistics if (s.measure, s.statistic) == (measure, statistic))
        return next(found, None)


def scores_of(cell: Cell, control_steps: int | None = None) -> Scores:
    """Returns the scores of a cell up to a control step, or of all that there is."""
    lengths = cell.lengths_up_to(control_steps)
    if control_steps is None:
        control_steps = int(np.nanmax(cell.control_steps))
    within = np.arange(cell.returns.shape[1]) < lengths[:, None]
    returns = np.where(within, cell.returns, np.nan)
    final = final_returns(returns, cell.control_steps, lengths, cell.kind.final_points)[0]
    there = np.isfinite(returns).sum(axis=1)
    area = np.divide(
        np.nansum(returns, axis=1), there, np.full(len(returns), np.nan), where=there > 0
    )
    known = np.isfinite(final) & np.isfinite(area)
    names = cell.task, cell.algo, cell.representation, cell.label
    return Scores(*names, final[known], area[known], control_steps)


def baseline_of(cell: Cell, cells: Sequence[Cell]) -> Cell | None:
    """Returns the cell that differs in nothing but that its agents see the full observation."""
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


def common_steps(*cells: Cell) -> int:
    """Returns the last control step that every seed of these cells has reached."""
    return int(min(cell.last_step for cell in cells))


def summaries(
    learned: Sequence[LearnedCurve], published: Sequence[PublishedCurve]
) -> list[Summary]:
    """Returns the statistics of each cell, in the same order."""
    cells = [item.cell for item in learned]
    found = []
    for item in learned:
        baseline = baseline_of(item.cell, cells)
        # What is published are training returns.
        theirs = published if item.cell.kind is TRAINING else ()
        best = best_at_end(theirs, item.cell.task)
        half = None if best is None else best / 2
        parts = (*_locations(item, half), *_spreads(item.cell), *_ratios(item.cell, baseline))
        found.append(Summary(item.cell, parts, baseline))
    return found


def statistics_frame(found: Sequence[Summary]) -> pd.DataFrame:
    """Returns a row for each statistic of each cell: the exact numbers behind the tables.

    Columns: returns (their kind), source, task, algo, representation, variant, settings, measure,
    statistic, value, low, high (ends of the 95% interval), interval (what these are), seeds,
    reached (seeds that reach the threshold), threshold (return), control_steps (up to which),
    compared_with (variant of the cell of the full observation, for ratios). An infinite number of
    steps is later than the runs' end.
    """
    rows = [
        (
            summary.cell.kind.name,
            *(getattr(summary.cell, name) for name in _CELL),
            one.measure,
            one.statistic,
            *one.estimate[:3],
            UNCERTAINTY,
            one.seeds,
            one.reached,
            one.threshold,
            one.control_steps,
            summary.baseline.variant
            if summary.baseline and one.statistic.endswith("_ratio")
            else None,
        )
        for summary in found
        for one in summary.statistics
    ]
    columns = ["returns", "source", "task", "algo", "representation", "variant", "settings"]
    columns += ["measure", "statistic", "value", "low", "high", "interval", "seeds", "reached"]
    frame = pd.DataFrame(rows, columns=[*columns, "threshold", "control_steps", "compared_with"])
    return frame.astype({"reached": "Int64"})


_CELL = ("source", "task", "algo", "representation", "variant", "label")


def _locations(item: LearnedCurve, half_best: float | None) -> Iterator[Statistic]:
    """Gives where the seeds' scores lie; robots learned on in turn have no steps to a return."""
    cell, curve = item
    whole = scores_of(cell)
    yield from _of_seeds("final_return", whole.final, _LOCATIONS, whole.control_steps)
    yield from _of_seeds("area", whole.area, _LOCATIONS, whole.control_steps)
    thresholds = {"steps_to_solved": float(SOLVED), "steps_to_half_best": half_best}
    for measure, threshold in thresholds.items():
        if threshold is not None and cell.robots <= 1:
            # A single episode at an end of the run is no moving average.
            each, at = curve.each[:, curve.full], curve.control_steps[curve.full]
            steps = st.steps_to_threshold(each, at, threshold)
            yield from _of_seeds(measure, steps, _LOCATIONS, whole.control_steps, threshold)


def _spreads(cell: Cell) -> Iterator[Statistic]:
    whole = scores_of(cell)
    if len(whole.final) > 1:
        yield from _of_seeds("final_return", whole.final, SPREADS, whole.control_steps)


def _ratios(cell: Cell, baseline: Cell | None) -> Iterator[Statistic]:
    if baseline is None:
        return
    common = common_steps(cell, baseline)
    ours, theirs = scores_of(cell, common).final, scores_of(baseline, common).final
    seeds = min(len(ours), len(theirs))
    if seeds < 2:
        return
    named = {f"{name}_ratio": st.ratio(spread) for name, spread in SPREADS.items()}
    made = st.estimates(list(named.values()), [ours], [theirs])
    for name, estimate in zip(named, made, strict=True):
        yield Statistic("final_return", name, estimate, seeds, None, None, common)


def _of_seeds(
    measure: str,
    scores: FloatArray,
    statistics: dict[str, st.Statistic],
    control_steps: int,
    threshold: float | None = None,
) -> Iterator[Statistic]:
    reached = None if threshold is None else int(np.isfinite(scores).sum())
    for name, estimate in zip(
        statistics, st.estimates(list(statistics.values()), [scores]), strict=True
    ):
        yield Statistic(measure, name, estimate, len(scores), reached, threshold, control_steps)
