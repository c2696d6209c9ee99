"""Which comparisons of a matrix are decided, and which seeds the undecided ones need next.

Looks are at 5, 10, 15 ... seeds from seed 0 and depend on nothing but the finished runs, so nothing
else is stored: a command that was interrupted finds again what its earlier looks decided.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jbench.errors import RequestError, WorkError
from jbench.names import kind_of, known
from jbench.report.analysis import sequential
from jbench.report.analysis.claims import MARGIN
from jbench.report.analysis.reduction import BASELINES
from jbench.report.data.curves import FloatArray, final_returns
from jbench.settings.alike import SEED, alike, with_implied
from jbench.settings.run import RunSettings
from jbench.store import Record, Results, schema
from jbench.sweeps.cell import Cell, all_runs
from jbench.training.status import run_status


class Comparison(NamedTuple):
    """Two cells that differ in nothing but their representation.

    Attributes:
        ours: of a reduced representation.
        theirs: of one of the `BASELINES`.
        against: which of them.
    """

    ours: Cell
    theirs: Cell
    against: str

    @property
    def name(self) -> str:
        """Names it for a reader."""
        cell = self.ours
        return f"{cell.task} {cell.algo} {cell.representation} against {self.against}"

    @property
    def claims(self) -> tuple[str, str]:
        """What a user types for all comparisons of its representation, and for it alone."""
        return self.ours.representation, f"{self.ours.representation}/{self.against}"


class Outcome(NamedTuple):
    """What the finished seeds say of a comparison.

    Attributes:
        comparison: of two cells.
        decision: at the look that decided, or at the last one.
        needed: runs up to the next look that are not finished; none if it is decided or has all
            seeds.
    """

    comparison: Comparison
    decision: sequential.Decision
    needed: list[RunSettings]


class Look(NamedTuple):
    """One look at all comparisons.

    Attributes:
        outcomes: of each comparison.
        needed: cells with the runs that undecided comparisons need next.
        tried: runs that were given to be trained before this look, by id.
    """

    outcomes: list[Outcome]
    needed: list[Cell]
    tried: dict[str, RunSettings]


class Numbers:
    """The number of each seed that is compared: its final return."""

    def __init__(self, results: Results) -> None:
        """Remembers where the runs are; a finished run is read once."""
        self._results = results
        self._known: dict[str, float] = {}

    def of(self, cell: Cell, most: int) -> FloatArray:
        """Returns the numbers of the first seeds, up to the first seed that is not finished."""
        found = []
        for seed in range(most):
            run = run_of(cell, seed)
            if run.id not in self._known:
                if run_status(run, self._results).state != "finished":
                    break
                record = self._results.find("run", run.id)
                assert record is not None
                self._known[run.id] = final_return(record)
            found.append(self._known[run.id])
        return np.array(found)


def final_return(record: Record) -> float:
    """Returns the mean return of a run's last evaluation.

    If it has no evaluations, it is that of the last training episodes: see `final_returns`.

    Raises:
        WorkError: if the rows can't be read, or the return is not finite.
    """
    rows = record.read("evaluations", schema.EVALUATIONS)
    if rows.num_rows:
        which = rows["evaluation"].to_numpy()
        returns = rows["episode_return"].to_numpy()[which == which.max()]
        found = float(returns.mean())
    else:
        rows = record.read("episodes", schema.EPISODES)
        returns, steps = (
            rows[name].to_numpy().astype(np.float64)[None]
            for name in ("episode_return", "control_steps")
        )
        found = float(final_returns(returns, steps, np.array([rows.num_rows]))[0][0])
    if not np.isfinite(found):
        raise WorkError(
            f"The final return of the run {record.id} is {found}; it can't be compared."
        )
    return found


def run_of(cell: Cell, seed: int) -> RunSettings:
    """Returns the run of a cell with a seed that the matrix itself may not have."""
    return cell.runs[0].model_copy(update={"seed": seed})


def comparisons(cells: Sequence[Cell], claims: Collection[str] = ()) -> list[Comparison]:
    """Returns the comparisons of each reduced representation with each baseline, in their order.

    Args:
        cells: of a matrix.
        claims: representations, as `dae12`, or pairs, as `dae12/full`; none for all.

    Raises:
        RequestError: if there are no comparisons, or none of a claim.
    """
    found = list(_all_comparisons(cells))
    if not found:
        raise RequestError(
            "No two cells of this matrix differ only in a representation and full or scaled, so "
            "there is nothing to decide; leave --until-decided out."
        )
    names = list(dict.fromkeys(name for one in found for name in one.claims))
    for claim in claims:
        known("claim", claim, names)
    return [one for one in found if not claims or {*one.claims} & {*claims}]


def _all_comparisons(cells: Sequence[Cell]) -> Iterator[Comparison]:
    by_kind = {(_likeness(cell), _kind(cell)): cell for cell in cells}
    for cell in cells:
        for against in BASELINES:
            theirs = by_kind.get((_likeness(cell), against))
            if _kind(cell) not in BASELINES and theirs is not None:
                yield Comparison(cell, theirs, against)


def _kind(cell: Cell) -> str:
    return kind_of(cell.runs[0].representation)


def _likeness(cell: Cell) -> str:
    """Returns what is the same text for cells that differ in their representation alone."""
    return alike(cell.runs[0], {*SEED, *with_implied("representation")})


def outcomes(
    asked: Sequence[Comparison], numbers: Numbers, results: Results, most: int
) -> list[Outcome]:
    """Returns what the finished seeds say of each comparison.

    The error rate is divided equally among the comparisons (Bonferroni), so it holds for all of
    them together, although they share cells.

    Args:
        asked: all comparisons that share the error rate.
        numbers: of the seeds.
        results: that hold the runs.
        most: seeds of a cell, a multiple of a block.
    """
    return [_outcome(one, numbers, results, most, rate_of_each(asked)) for one in asked]


def rate_of_each(asked: Sequence[Comparison]) -> float:
    """Returns the error rate of each of several comparisons."""
    return sequential.ERROR_RATE / len(asked)


def _outcome(
    one: Comparison, numbers: Numbers, results: Results, most: int, error_rate: float
) -> Outcome:
    ours, theirs = numbers.of(one.ours, most), numbers.of(one.theirs, most)
    decision = sequential.compare(ours, theirs, MARGIN, error_rate, most // sequential.BLOCK)
    needed = []
    if decision.verdict == "undecided":
        seeds = range(min(decision.seeds + sequential.BLOCK, most))
        runs = (run_of(cell, seed) for cell in (one.ours, one.theirs) for seed in seeds)
        needed = [run for run in runs if run_status(run, results).state != "finished"]
    return Outcome(one, decision, needed)


def next_cells(found: Sequence[Outcome], tried: Mapping[str, RunSettings]) -> list[Cell]:
    """Returns the cells of undecided comparisons, each with the runs that it needs next.

    A comparison that needs a run which was tried and is still not finished gets no more seeds.
    """
    cells: dict[str, Cell] = {}
    for one in found:
        if any(run.id in tried for run in one.needed):
            continue
        for cell in (one.comparison.theirs, one.comparison.ours):
            key = run_of(cell, 0).id
            mine = {run.id: run for run in one.needed if run_of(cell, run.seed) == run}
            if mine:
                before = {run.id: run for run in cells[key].runs} if key in cells else {}
                runs = sorted((before | mine).values(), key=lambda run: run.seed)
                cells[key] = cell._replace(runs=runs)
    return list(cells.values())


def looks(
    asked: Sequence[Comparison],
    results: Results,
    most: int,
    train: Callable[[Sequence[Cell]], object] | None,
) -> Iterator[Look]:
    """Adds seeds in blocks until all comparisons are decided or have all seeds; yields each look.

    Args:
        asked: comparisons of a matrix.
        results: that hold the runs.
        most: seeds of a cell, a multiple of a block.
        train: trains the runs of cells (`jbench.sweeps.scheduler.sweep`); None to look once.
    """
    numbers, tried = Numbers(results), dict[str, RunSettings]()
    while True:
        found = outcomes(asked, numbers, results, most)
        needed = next_cells(found, tried)
        yield Look(found, needed, tried)
        if not needed or train is None:
            return
        tried = tried | {run.id: run for run in all_runs(needed)}
        train(needed)
