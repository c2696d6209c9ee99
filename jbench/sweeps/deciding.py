"""Sequential comparisons of a matrix: which are decided, and which seeds the others need next.

Interim analyses are at 5, 10, 15 ... seeds from seed 0. They depend only on the finished runs, so
no other state is stored, and an interrupted command reaches the same decisions again.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jbench.encoders.settings import EncoderSettings
from jbench.errors import WorkError
from jbench.report.analysis.claims import MARGIN
from jbench.report.data.curves import final_returns
from jbench.settings.run import RunSettings
from jbench.statistics import FloatArray, sequential
from jbench.statistics.step_down import Decision, decide
from jbench.store import Record, Results
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.comparisons import Claim, MatrixComparison
from jbench.training.status import run_status


class ComparisonOutcome(NamedTuple):
    """ComparisonOutcome of a comparison with the finished seeds.

    Attributes:
        decision: decision at the deciding interim analysis, or at the last one.
        needed: unfinished runs up to the next analysis; empty if it is decided or has all seeds.
    """

    comparison: MatrixComparison
    decision: Decision
    needed: list[RunSettings]


class InterimAnalysis(NamedTuple):
    """One interim analysis of all comparisons.

    Attributes:
        needed: cells with the runs that undecided comparisons need next.
        tried: runs that were trained before this analysis, by id, finished or not.
    """

    outcomes: list[ComparisonOutcome]
    needed: list[Cell]
    tried: dict[str, RunSettings]


class Numbers:
    """The compared return of each seed; a finished run is read once."""

    def __init__(self, results: Results) -> None:
        self._results = results
        self._known: dict[tuple[str, Claim], float] = {}

    def first_seeds(self, cell: Cell, max_seeds: int, claim: Claim) -> FloatArray:
        """Returns the returns of the first seeds, up to the first unfinished one."""
        returns = []
        for seed in range(max_seeds):
            run = run_with_seed(cell, seed)
            if (run.id, claim) not in self._known:
                if run_status(run, self._results).state != "finished":
                    break
                record = self._results.find("run", run.id)
                assert record is not None
                self._known[run.id, claim] = compared_return(record, claim)
            returns.append(self._known[run.id, claim])
        return np.array(returns)


def compared_return(record: Record, claim: Claim = "a") -> float:
    """Returns the mean return of a run's last evaluation (a), or of all evaluations (c).

    Without evaluations, it is the mean over the last training episodes (see `final_returns`), or
    over all.

    Raises:
        WorkError: if the rows can't be read, or the return is not finite.
    """
    rows = record.read("evaluations")
    if rows.num_rows:
        which, returns = (rows[name].to_numpy() for name in ("evaluation", "episode_return"))
        points = [returns[which == evaluation].mean() for evaluation in np.unique(which)]
        mean = float(points[-1] if claim == "a" else np.mean(points))
    else:
        rows = record.read("episodes")
        returns, steps = (
            rows[name].to_numpy().astype(np.float64)[None]
            for name in ("episode_return", "control_steps")
        )
        final = final_returns(returns, steps, np.array([rows.num_rows]))[0][0]
        mean = float(final if claim == "a" else returns.mean())
    if not np.isfinite(mean):
        raise WorkError(f"The return of the run {record.id} is {mean}; it can't be compared.")
    return mean


def run_with_seed(cell: Cell, seed: int) -> RunSettings:
    """Returns the run of a cell with any seed, which need not be in the matrix."""
    run = cell.runs[0].model_copy(update={"seed": seed})
    if run.encoder_draws is None:
        return run
    return run.model_copy(update={"encoder": _draw(cell, seed).id})


def _draw(cell: Cell, seed: int) -> EncoderSettings:
    """Returns the encoder of a seed, of a cell whose seeds have encoders of their own."""
    return cell.encoders[0].model_copy(update={"seed": seed})


def _with_runs(cell: Cell, runs: Sequence[RunSettings]) -> Cell:
    """Returns a cell of other seeds, with their encoders."""
    if cell.runs[0].encoder_draws is None:
        return cell._replace(runs=list(runs))
    draws = tuple(_draw(cell, run.seed) for run in runs)
    return cell._replace(runs=list(runs), encoders=draws)


def outcomes(
    chosen: Sequence[MatrixComparison], numbers: Numbers, results: Results, max_seeds: int
) -> list[ComparisonOutcome]:
    """Returns the outcome of each comparison with the finished seeds.

    Args:
        chosen: all comparisons that share the error rate.
        max_seeds: maximum number of seeds per cell where a comparison has none, a multiple of the
            block size.
    """
    limits = [comparison.max_seeds or max_seeds for comparison in chosen]
    pairs = [
        (
            numbers.first_seeds(comparison.ours, limit, comparison.claim),
            numbers.first_seeds(comparison.theirs, limit, comparison.claim),
        )
        for comparison, limit in zip(chosen, limits, strict=True)
    ]
    looks = [limit // sequential.BLOCK for limit in limits]
    decisions = decide(pairs, [comparison.share for comparison in chosen], looks, MARGIN)
    return [
        ComparisonOutcome(comparison, decision, _needed(comparison, decision, limit, results))
        for comparison, decision, limit in zip(chosen, decisions, limits, strict=True)
    ]


def _needed(
    comparison: MatrixComparison, decision: Decision, max_seeds: int, results: Results
) -> list[RunSettings]:
    if decision.verdict != "undecided":
        return []
    seeds = range(min(decision.seeds + sequential.BLOCK, max_seeds))
    runs = (
        run_with_seed(cell, seed) for cell in (comparison.ours, comparison.theirs) for seed in seeds
    )
    return [run for run in runs if run_status(run, results).state != "finished"]


def next_cells(
    outcomes: Sequence[ComparisonOutcome], tried: Mapping[str, RunSettings]
) -> list[Cell]:
    """Returns the cells of undecided comparisons, each with the runs that it needs next.

    A comparison gets no more seeds if it needs a run that was tried and is still unfinished.
    """
    cells: dict[str, Cell] = {}
    for outcome in outcomes:
        if any(run.id in tried for run in outcome.needed):
            continue
        for cell in (outcome.comparison.theirs, outcome.comparison.ours):
            key = run_with_seed(cell, 0).id
            mine = {run.id: run for run in outcome.needed if run_with_seed(cell, run.seed) == run}
            if mine:
                before = {run.id: run for run in cells[key].runs} if key in cells else {}
                runs = sorted((before | mine).values(), key=lambda run: run.seed)
                cells[key] = _with_runs(cell, runs)
    return list(cells.values())


def interim_analyses(
    chosen: Sequence[MatrixComparison],
    results: Results,
    max_seeds: int,
    train: Callable[[Sequence[Cell]], object] | None,
) -> Iterator[InterimAnalysis]:
    """Adds seeds in blocks until the comparisons are decided or have all; yields each analysis.

    Args:
        max_seeds: maximum number of seeds per cell, a multiple of the block size.
        train: trains the runs of cells (`jbench.sweeps.scheduler.sweep`); None for one analysis.
    """
    numbers, tried = Numbers(results), dict[str, RunSettings]()
    while True:
        reached = outcomes(chosen, numbers, results, max_seeds)
        needed = next_cells(reached, tried)
        yield InterimAnalysis(reached, needed, tried)
        if not needed or train is None:
            return
        tried = tried | {run.id: run for run in all_runs(needed)}
        train(needed)
