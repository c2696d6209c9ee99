"""Sequential comparisons of a matrix: which are decided, and which seeds the others need next.

Interim analyses are at 5, 10, 15 ... seeds from seed 0. They depend only on the finished runs, so
no other state is stored, and an interrupted command reaches the same decisions again.
"""

from collections.abc import Container, Sequence
from typing import NamedTuple

import numpy as np

from jbench.errors import WorkError
from jbench.report.analysis.claims import MARGIN
from jbench.report.data.curves import final_returns
from jbench.settings.run import RunSettings
from jbench.statistics import FloatArray, sequential
from jbench.statistics.step_down import Decision, decide
from jbench.store import Record, Results
from jbench.sweeps.cell import Cell, with_runs
from jbench.sweeps.comparisons import MatrixComparison
from jbench.sweeps.matrix import Claim
from jbench.training.status import run_status


class ComparisonOutcome(NamedTuple):
    """The decision at the deciding interim analysis of finished seeds, or at the last one.

    `needed` are the unfinished runs up to the next analysis; empty if it is decided or has all
    seeds.
    """

    comparison: MatrixComparison
    decision: Decision
    needed: list[RunSettings]


def compared_return(record: Record, claim: Claim = "a") -> float:
    """Returns the mean return of a run's last evaluation (a), or of all evaluations (c).

    Without evaluations, it is the mean over the last training episodes (see `final_returns`), or
    over all. Raises a WorkError if the rows can't be read, or the return is not finite.
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


def outcomes(
    chosen: Sequence[MatrixComparison], results: Results, returns: dict[tuple[str, Claim], float]
) -> list[ComparisonOutcome]:
    """Returns the outcome of each comparison with the finished seeds.

    All chosen comparisons share the error rate. The returns that are read are added to `returns`.
    """
    pairs = [
        (
            _first_returns(comparison.ours, comparison, results, returns),
            _first_returns(comparison.theirs, comparison, results, returns),
        )
        for comparison in chosen
    ]
    shares = [comparison.share for comparison in chosen]
    looks = [comparison.max_seeds // sequential.BLOCK for comparison in chosen]
    return [
        ComparisonOutcome(comparison, decision, _needed(comparison, decision, results))
        for comparison, decision in zip(chosen, decide(pairs, shares, looks, MARGIN), strict=True)
    ]


def _first_returns(
    cell: Cell,
    comparison: MatrixComparison,
    results: Results,
    returns: dict[tuple[str, Claim], float],
) -> FloatArray:
    """Returns the returns of a cell's first seeds, up to the first unfinished one."""
    first = []
    for run in cell.runs[: comparison.max_seeds]:
        key = run.id, comparison.claim
        if key not in returns:
            if run_status(run, results).state != "finished":
                break
            record = results.find("run", run.id)
            assert record is not None
            returns[key] = compared_return(record, comparison.claim)
        first.append(returns[key])
    return np.array(first)


def _needed(
    comparison: MatrixComparison, decision: Decision, results: Results
) -> list[RunSettings]:
    if decision.verdict != "undecided":
        return []
    seeds = min(decision.seeds + sequential.BLOCK, comparison.max_seeds)
    runs = (*comparison.ours.runs[:seeds], *comparison.theirs.runs[:seeds])
    return [run for run in runs if run_status(run, results).state != "finished"]


def next_cells(outcomes: Sequence[ComparisonOutcome], tried: Container[str]) -> list[Cell]:
    """Returns the cells of undecided comparisons, each with the runs that it needs next.

    A comparison gets no more seeds if it needs a run whose id was tried and is still unfinished.
    """
    going_on = [
        outcome
        for outcome in outcomes
        if outcome.needed and not any(run.id in tried for run in outcome.needed)
    ]
    needed = {run.id for outcome in going_on for run in outcome.needed}
    cells = {
        cell.runs[0].id: cell
        for outcome in going_on
        for cell in (outcome.comparison.theirs, outcome.comparison.ours)
    }
    return with_runs(cells.values(), needed)
