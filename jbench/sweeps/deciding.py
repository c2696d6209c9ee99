"""Sequential comparisons of a matrix: which are decided, and which seeds the others need next.

Looks are at 5, 10, 15 ... seeds from seed 0. They depend only on the finished runs, so no other
state is stored, and an interrupted command reaches the same decisions again.
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
from jbench.store import Record, Results
from jbench.sweeps.cell import Cell, all_runs
from jbench.training.status import run_status


class Comparison(NamedTuple):
    """Two cells that differ only in their representation.

    Attributes:
        ours: cell of a reduced representation.
        theirs: cell of a baseline.
        against: name of the baseline, one of `BASELINES`.
    """

    ours: Cell
    theirs: Cell
    against: str

    @property
    def name(self) -> str:
        """Name in tables."""
        cell = self.ours
        return f"{cell.task} {cell.algo} {cell.representation} against {self.against}"

    @property
    def claims(self) -> tuple[str, str]:
        """What a user types for all comparisons of this representation, and for this one only."""
        return self.ours.representation, f"{self.ours.representation}/{self.against}"


class Outcome(NamedTuple):
    """Outcome of a comparison with the finished seeds.

    Attributes:
        decision: decision at the deciding look, or at the last one.
        needed: unfinished runs up to the next look; empty if it is decided or has all seeds.
    """

    comparison: Comparison
    decision: sequential.Decision
    needed: list[RunSettings]


class Look(NamedTuple):
    """One look (interim analysis) at all comparisons.

    Attributes:
        needed: cells with the runs that undecided comparisons need next.
        tried: runs that were trained before this look, by id, finished or not.
    """

    outcomes: list[Outcome]
    needed: list[Cell]
    tried: dict[str, RunSettings]


class Numbers:
    """The final return of each seed; a finished run is read once."""

    def __init__(self, results: Results) -> None:
        self._results = results
        self._known: dict[str, float] = {}

    def of(self, cell: Cell, max_seeds: int) -> FloatArray:
        """Returns the final returns of the first seeds, up to the first unfinished one."""
        returns = []
        for seed in range(max_seeds):
            run = run_of(cell, seed)
            if run.id not in self._known:
                if run_status(run, self._results).state != "finished":
                    break
                record = self._results.find("run", run.id)
                assert record is not None
                self._known[run.id] = final_return(record)
            returns.append(self._known[run.id])
        return np.array(returns)


def final_return(record: Record) -> float:
    """Returns the mean return of a run's last evaluation.

    Without evaluations, it is the mean over the last training episodes; see `final_returns`.

    Raises:
        WorkError: if the rows can't be read, or the return is not finite.
    """
    rows = record.read("evaluations")
    if rows.num_rows:
        which = rows["evaluation"].to_numpy()
        returns = rows["episode_return"].to_numpy()[which == which.max()]
        mean = float(returns.mean())
    else:
        rows = record.read("episodes")
        returns, steps = (
            rows[name].to_numpy().astype(np.float64)[None]
            for name in ("episode_return", "control_steps")
        )
        mean = float(final_returns(returns, steps, np.array([rows.num_rows]))[0][0])
    if not np.isfinite(mean):
        raise WorkError(f"The final return of the run {record.id} is {mean}; it can't be compared.")
    return mean


def run_of(cell: Cell, seed: int) -> RunSettings:
    """Returns the run of a cell with any seed, which need not be in the matrix."""
    return cell.runs[0].model_copy(update={"seed": seed})


def comparisons(cells: Sequence[Cell], claims: Collection[str] = ()) -> list[Comparison]:
    """Returns the comparisons of each reduced representation with each baseline, in order.

    Args:
        claims: representations such as `dae12`, or pairs such as `dae12/full`; empty for all.

    Raises:
        RequestError: if there are no comparisons, or a claim matches none of them.
    """
    every = list(_all_comparisons(cells))
    if not every:
        raise RequestError(
            "No two cells of this matrix differ only in a representation and full or scaled, so "
            "there is nothing to decide; leave --until-decided out."
        )
    names = list(dict.fromkeys(name for one in every for name in one.claims))
    for claim in claims:
        known("comparison", claim, names)
    return [one for one in every if not claims or {*one.claims} & {*claims}]


def _all_comparisons(cells: Sequence[Cell]) -> Iterator[Comparison]:
    by_kind = {(_key(cell), _kind(cell)): cell for cell in cells}
    for cell in cells:
        for against in BASELINES:
            theirs = by_kind.get((_key(cell), against))
            if _kind(cell) not in BASELINES and theirs is not None:
                yield Comparison(cell, theirs, against)


def _kind(cell: Cell) -> str:
    return kind_of(cell.runs[0].representation)


def _key(cell: Cell) -> str:
    """Returns a key that is equal for cells that differ only in their representation."""
    return alike(cell.runs[0], {*SEED, *with_implied("representation")})


def outcomes(
    chosen: Sequence[Comparison], numbers: Numbers, results: Results, max_seeds: int
) -> list[Outcome]:
    """Returns the outcome of each comparison with the finished seeds.

    The error rate is divided equally among the comparisons (Bonferroni). It therefore holds for
    all of them together, although they share cells.

    Args:
        chosen: all comparisons that share the error rate.
        max_seeds: maximum number of seeds per cell, a multiple of the block size.
    """
    return [_outcome(one, numbers, results, max_seeds, rate_of_each(chosen)) for one in chosen]


def rate_of_each(chosen: Sequence[Comparison]) -> float:
    """Returns the error rate of each comparison."""
    return sequential.ERROR_RATE / len(chosen)


def _outcome(
    one: Comparison, numbers: Numbers, results: Results, max_seeds: int, error_rate: float
) -> Outcome:
    ours, theirs = numbers.of(one.ours, max_seeds), numbers.of(one.theirs, max_seeds)
    decision = sequential.compare(ours, theirs, MARGIN, error_rate, max_seeds // sequential.BLOCK)
    needed = []
    if decision.verdict == "undecided":
        seeds = range(min(decision.seeds + sequential.BLOCK, max_seeds))
        runs = (run_of(cell, seed) for cell in (one.ours, one.theirs) for seed in seeds)
        needed = [run for run in runs if run_status(run, results).state != "finished"]
    return Outcome(one, decision, needed)


def next_cells(outcomes: Sequence[Outcome], tried: Mapping[str, RunSettings]) -> list[Cell]:
    """Returns the cells of undecided comparisons, each with the runs that it needs next.

    A comparison gets no more seeds if it needs a run that was tried and is still unfinished.
    """
    cells: dict[str, Cell] = {}
    for one in outcomes:
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
    chosen: Sequence[Comparison],
    results: Results,
    max_seeds: int,
    train: Callable[[Sequence[Cell]], object] | None,
) -> Iterator[Look]:
    """Adds seeds in blocks until all comparisons are decided or have all seeds; yields each look.

    Args:
        max_seeds: maximum number of seeds per cell, a multiple of the block size.
        train: trains the runs of cells (`jbench.sweeps.scheduler.sweep`); None to look once.
    """
    numbers, tried = Numbers(results), dict[str, RunSettings]()
    while True:
        found = outcomes(chosen, numbers, results, max_seeds)
        needed = next_cells(found, tried)
        yield Look(found, needed, tried)
        if not needed or train is None:
            return
        tried = tried | {run.id: run for run in all_runs(needed)}
        train(needed)
