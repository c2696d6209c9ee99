"""Sequential comparisons of a matrix: which are decided, and which seeds the others need next.

They are those that its file lists, or each representation with the baselines. Interim analyses are
at 5, 10, 15 ... seeds from seed 0. They depend only on the finished runs, so no other state is
stored, and an interrupted command reaches the same decisions again.
"""

from collections.abc import Collection, Container, Iterator, Sequence
from functools import cache
from itertools import product, takewhile
from typing import NamedTuple

import numpy as np

from jbench.errors import RequestError, WorkError
from jbench.names import kind_in, known
from jbench.report.analysis.claims import MARGIN
from jbench.report.analysis.verdicts import BASELINES
from jbench.returns import final_return
from jbench.settings.recorded import SEED, alike, with_implied
from jbench.settings.run import RunSettings
from jbench.statistics import FloatArray
from jbench.statistics.sequential import BLOCK, ERROR_RATE
from jbench.statistics.step_down import Decision, decide
from jbench.store import Record, Results
from jbench.store.evaluations import added_returns, evaluation_returns
from jbench.sweeps.cell import Cell, is_finished, with_runs
from jbench.sweeps.matrix import COMPARISON, Claim, Planned, named

_NO_DECISION = Decision("undecided", 0, np.nan, -np.inf, np.inf, rate=0.0, spent=0.0)


class MatrixComparison(NamedTuple):
    """Two cells that differ only in their representation, with runs of the seeds from 0 on.

    `share` is that of the error rate, before other comparisons pass theirs on. `max_seeds` per cell
    is a multiple of the block size. `needed` are the unfinished runs up to the next interim
    analysis, if any, after the `decision` so far.
    """

    ours: Cell
    theirs: Cell
    against: str
    share: float = ERROR_RATE
    claim: Claim = "a"
    max_seeds: int = 0
    decision: Decision = _NO_DECISION
    needed: Sequence[RunSettings] = ()

    @property
    def name(self) -> str:
        """Name in tables."""
        cell = self.ours
        name = f"{cell.task} {cell.algo} {cell.representation} against {self.against}"
        return name if self.claim == "a" else f"{name}, over the run"

    @property
    def claims(self) -> list[str]:
        """What a user types for all comparisons of this representation, and for this one only."""
        return [claim for n in _names(self.ours) for claim in (n, f"{n}/{self.against}")]


def comparisons(
    cells: Sequence[Cell], planned: Sequence[Planned], claims: Collection[str], max_seeds: int
) -> list[MatrixComparison]:
    """Returns the planned comparisons, or those of each reduced representation with each baseline.

    A planned comparison has its share of the error rate whether or not the others are requested;
    the others divide the whole rate equally among those that are requested. Claims are
    representations such as `dae12`, or pairs such as `dae12/full`; none for all. `max_seeds` is for
    entries that have none. Raises a RequestError if there are no comparisons, a claim matches none
    of them, or the cells have not exactly one pair for a planned comparison.
    """
    every = _with_cells(cells, planned) if planned else list(_with_baselines(cells))
    every = [pair._replace(max_seeds=pair.max_seeds or max_seeds) for pair in every]
    if not every:
        raise RequestError(
            "No two configurations of this matrix differ only in a representation and full or "
            "scaled, so there is nothing to decide; leave --until-decided out."
        )
    names = list(dict.fromkeys(name for pair in every for name in pair.claims))
    for claim in claims:
        known("comparison", claim, names)
    chosen = [pair for pair in every if not claims or {*pair.claims} & {*claims}]
    return chosen if planned else [pair._replace(share=ERROR_RATE / len(chosen)) for pair in chosen]


def _with_cells(cells: Sequence[Cell], planned: Sequence[Planned]) -> list[MatrixComparison]:
    listed: list[MatrixComparison] = []
    for n, entry in enumerate(planned, 1):
        with named(f"{COMPARISON} {n}"):
            if entry.first == entry.second:
                raise RequestError(f"first and second are both {entry.first}; name another one.")
            pair = _pair(cells, entry)
            if any((other[:2], other.claim) == (pair, entry.claim) for other in listed):
                raise RequestError(f"{entry.first} against {entry.second} is listed twice.")
            share, most = entry.share, entry.max_seeds
            listed.append(MatrixComparison(*pair, entry.second, share, entry.claim, most))
    return listed


def _pair(cells: Sequence[Cell], entry: Planned) -> tuple[Cell, Cell]:
    cells = [cell for cell in cells if (cell.task, cell.algo) == (entry.task, entry.algo)]
    pairs = [
        (ours, theirs)
        for ours, theirs in product(cells, repeat=2)
        if entry.first in _names(ours)
        and entry.second in _names(theirs)
        and entry.steps in (None, ours.runs[0].steps)
        and _key(ours) == _key(theirs)
    ]
    both = f"{entry.first} and {entry.second} of {entry.algo} on {entry.task}"
    if not pairs:
        steps = "" if entry.steps is None else f" with {entry.steps} control steps"
        raise RequestError(
            f"the matrix has no {both}{steps} that differ only in their representation; choose "
            "others, or give both the same settings."
        )
    if len(pairs) > 1:
        raise RequestError(
            f"the matrix has {both} with {len(pairs)} settings; write the steps = … to compare."
        )
    return pairs[0]


def _names(cell: Cell) -> list[str]:
    """Returns the representation of a cell as typed, and with its size, each once."""
    return list(dict.fromkeys((cell.representation, cell.runs[0].representation)))


def _with_baselines(cells: Sequence[Cell]) -> Iterator[MatrixComparison]:
    keyed = [(_key(cell), kind_in(cell.runs[0].representation), cell) for cell in cells]
    by_kind = {(key, kind): cell for key, kind, cell in keyed}
    for key, kind, cell in keyed:
        for against in BASELINES if kind not in BASELINES else ():
            if (theirs := by_kind.get((key, against))) is not None:
                yield MatrixComparison(cell, theirs, against)


def _key(cell: Cell) -> str:
    """Returns a key that is equal for cells that differ only in their representation."""
    return alike(cell.runs[0], {*SEED, *with_implied("representation")})


def compared_return(record: Record, claim: Claim = "a", added: Sequence[FloatArray] = ()) -> float:
    """Returns the mean return of a run's last evaluation (a), or of all evaluations (c).

    Added returns join the last one. Without evaluations, it is the mean over the last training
    episodes (see `final_return`), or over all. Raises a WorkError if the rows can't be read, or the
    return is not finite.
    """
    which, returns = evaluation_returns(record, added)
    if len(which):
        points = [returns[which == evaluation].mean() for evaluation in np.unique(which)]
        mean = points[-1] if claim == "a" else float(np.mean(points))
    else:
        returns = record.read("episodes")["episode_return"].to_numpy()
        mean = final_return(returns) if claim == "a" else returns.mean()
    if mean is None or not np.isfinite(mean):
        raise WorkError(f"The return of the run {record.id} is {mean}; it can't be compared.")
    return float(mean)


def outcomes(chosen: Sequence[MatrixComparison], results: Results) -> list[MatrixComparison]:
    """Decides comparisons by the first seeds of each cell, up to the first unfinished one.

    Raises a WorkError if an evaluation can't be read, since it might join a run.
    """
    cells = (cell for pair in chosen for cell in (pair.ours, pair.theirs))
    runs = {run.id: run.model_dump() for cell in cells for run in cell.runs}
    added, problems = added_returns(results, runs)
    if problems:
        raise WorkError(problems[0])

    @cache
    def finished_return(run: str, claim: Claim) -> float | None:
        record = results.find("run", run) if is_finished(results, "run", run) else None
        return None if record is None else compared_return(record, claim, added.get(run, ()))

    def first_returns(cell: Cell, pair: MatrixComparison) -> FloatArray:
        returns = (finished_return(run.id, pair.claim) for run in cell.runs[: pair.max_seeds])
        return np.array([*takewhile(lambda number: number is not None, returns)], float)

    pairs = [(first_returns(pair.ours, pair), first_returns(pair.theirs, pair)) for pair in chosen]
    shares, analyses = [pair.share for pair in chosen], [pair.max_seeds // BLOCK for pair in chosen]
    reached = []
    for pair, decision in zip(chosen, decide(pairs, shares, analyses, MARGIN), strict=True):
        undecided = decision.verdict == "undecided"
        seeds = min(decision.seeds + BLOCK, pair.max_seeds) if undecided else 0
        next_runs = (*pair.ours.runs[:seeds], *pair.theirs.runs[:seeds])
        needed = [run for run in next_runs if not is_finished(results, "run", run.id)]
        reached.append(pair._replace(decision=decision, needed=needed))
    return reached


def next_cells(reached: Sequence[MatrixComparison], tried: Container[str]) -> list[Cell]:
    """Returns cells with the runs that undecided comparisons need, unless one was tried before."""
    going_on = [pair for pair in reached if not any(run.id in tried for run in pair.needed)]
    needed = {run.id for pair in going_on for run in pair.needed}
    cells = {cell.runs[0].id: cell for pair in going_on for cell in (pair.theirs, pair.ours)}
    return with_runs(cells.values(), needed)
