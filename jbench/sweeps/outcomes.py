"""Planned comparisons in a sweep: what is decided so far, and which seeds the others need next."""

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from functools import cache

from jbench.array_types import FloatArray
from jbench.errors import WorkError
from jbench.returns import EVALUATION, TRAINING, evaluation_means
from jbench.settings.run import RunSettings
from jbench.statistics.sequential import BLOCK
from jbench.statistics.step_down import Decision
from jbench.store import Record, Results
from jbench.store.evaluations import added_returns, evaluation_returns
from jbench.studies.deciding import Returns, compared_return, decide
from jbench.studies.entries import Claim
from jbench.studies.study import PlannedComparison
from jbench.sweeps.cell import Cell, with_runs


@dataclass(frozen=True)
class Outcome:
    """What a comparison of a matrix has come to.

    Attributes:
        cells: those of its first and its second arm, with runs of the seeds from 0 on.
        needed: the unfinished runs up to the next interim analysis, if the decision is open.
        unknown: the first finished run without a finite return, which stops the comparison; empty
            if there is none.
    """

    comparison: PlannedComparison
    cells: tuple[Cell, Cell]
    decision: Decision
    needed: Sequence[RunSettings] = ()
    unknown: str = ""


def recorded_return(
    record: Record, claim: Claim = "a", added: Sequence[FloatArray] = ()
) -> float | None:
    """Returns the number of a run that a claim compares: its final return, or its mean return.

    They are of its evaluations, the last of which added returns join; without any, of its training
    episodes. None if no return is finite. Raises a WorkError if the rows can't be read.
    """
    kind = EVALUATION
    points = evaluation_means(*evaluation_returns(record, added))
    if not len(points):
        kind = TRAINING
        points = record.read("episodes")["episode_return"].to_numpy()
    return compared_return(points, kind, claim)


def outcomes(
    comparisons: Sequence[PlannedComparison], cells: Sequence[Cell], results: Results
) -> list[Outcome]:
    """Decides comparisons by the first seeds of each cell, up to the first unfinished one.

    Raises a WorkError if an evaluation can't be read, since it might join a run.
    """
    by_arm = {arm.training_key: cell for cell in cells for arm in cell.arms}
    pairs = [
        (by_arm[comparison.first.training_key], by_arm[comparison.second.training_key])
        for comparison in comparisons
    ]
    runs = {run.id: run.model_dump() for pair in pairs for cell in pair for run in cell.runs}
    added, problems = added_returns(results, runs)
    if problems:
        raise WorkError(problems[0])

    @cache
    def finished(run: str) -> bool:
        return results.is_finished("run", run)

    @cache
    def finished_return(run: str, claim: Claim) -> float | None:
        record = results.find("run", run)
        return None if record is None else recorded_return(record, claim, added.get(run, ()))

    def returns(cell: Cell, claim: Claim) -> Returns:
        return {run.seed: finished_return(run.id, claim) for run in cell.runs if finished(run.id)}

    sides = [
        (returns(first, comparison.claim), returns(second, comparison.claim))
        for comparison, (first, second) in zip(comparisons, pairs, strict=True)
    ]
    decisions = decide(comparisons, sides)

    return [
        _outcome(comparison, pair, both, decision, finished)
        for comparison, pair, both, decision in zip(
            comparisons, pairs, sides, decisions, strict=True
        )
    ]


def _outcome(
    comparison: PlannedComparison,
    cells: tuple[Cell, Cell],
    returns: tuple[Returns, Returns],
    decision: Decision,
    finished: Callable[[str], bool],
) -> Outcome:
    """Returns what is decided of a comparison, and the runs that the next analysis needs."""
    if decision.verdict != "undecided":
        return Outcome(comparison, cells, decision)

    seeds = min(decision.seeds + BLOCK, comparison.max_seeds)
    needed: list[RunSettings] = []
    unknown: list[str] = []
    for cell, known in zip(cells, returns, strict=True):
        for run in cell.runs[:seeds]:
            if not finished(run.id):
                needed.append(run)
            elif known[run.seed] is None:
                unknown.append(run.id)

    return Outcome(comparison, cells, decision, needed, unknown[0] if unknown else "")


def next_cells(reached: Sequence[Outcome], tried: Container[str]) -> list[Cell]:
    """Returns cells with the runs that undecided comparisons need.

    A comparison waits if one of its runs was tried before, or has no finite return.
    """
    going_on = [
        outcome
        for outcome in reached
        if not outcome.unknown and not any(run.id in tried for run in outcome.needed)
    ]
    needed = {run.id for outcome in going_on for run in outcome.needed}
    cells = {cell.runs[0].id: cell for outcome in going_on for cell in reversed(outcome.cells)}
    return with_runs(cells.values(), needed)
