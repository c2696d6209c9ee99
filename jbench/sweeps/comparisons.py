"""Comparisons of a matrix: those that its file lists, or each representation with the baselines."""

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from jbench.errors import RequestError
from jbench.names import kind_in, known
from jbench.report.analysis.verdicts import BASELINES
from jbench.settings.alike import SEED, alike, with_implied
from jbench.statistics.sequential import ERROR_RATE
from jbench.sweeps.cell import Cell
from jbench.sweeps.matrix import COMPARISON, Claim, Planned, named


class MatrixComparison(NamedTuple):
    """Two cells that differ only in their representation, with runs of the seeds from 0 on.

    `share` is that of the error rate, before other comparisons pass theirs on. `max_seeds` per cell
    is a multiple of the block size.
    """

    ours: Cell
    theirs: Cell
    against: str
    share: float
    claim: Claim = "a"
    max_seeds: int = 0

    @property
    def name(self) -> str:
        """Name in tables."""
        cell = self.ours
        name = f"{cell.task} {cell.algo} {cell.representation} against {self.against}"
        return name if self.claim == "a" else f"{name}, over the run"

    @property
    def claims(self) -> list[str]:
        """What a user types for all comparisons of this representation, and for this one only."""
        names = dict.fromkeys(_names(self.ours))
        return [claim for name in names for claim in (name, f"{name}/{self.against}")]


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
    if planned:
        return chosen
    return [pair._replace(share=ERROR_RATE / len(chosen)) for pair in chosen]


def _with_cells(cells: Sequence[Cell], planned: Sequence[Planned]) -> list[MatrixComparison]:
    listed: list[MatrixComparison] = []
    for n, entry in enumerate(planned, 1):
        with named(f"{COMPARISON} {n}"):
            if entry.first == entry.second:
                raise RequestError(
                    f"first and second are both {entry.first}; name two representations."
                )
            pair = _pair(cells, entry)
            same = [(other.ours, other.theirs, other.claim) for other in listed]
            if (*pair, entry.claim) in same:
                raise RequestError(f"{entry.first} against {entry.second} is listed twice.")
            assert entry.share is not None
            listed.append(
                MatrixComparison(
                    *pair, entry.second, entry.share, entry.claim, entry.max_seeds or 0
                )
            )
    return listed


def _pair(cells: Sequence[Cell], entry: Planned) -> tuple[Cell, Cell]:
    cells = [cell for cell in cells if (cell.task, cell.algo) == (entry.task, entry.algo)]
    pairs = [
        (ours, theirs)
        for ours in cells
        for theirs in cells
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


def _names(cell: Cell) -> tuple[str, str]:
    """Returns the representation of a cell as typed, and with its size."""
    return cell.representation, cell.runs[0].representation


def _with_baselines(cells: Sequence[Cell]) -> Iterator[MatrixComparison]:
    by_kind = {(_key(cell), _kind(cell)): cell for cell in cells}
    for cell in cells:
        for against in BASELINES:
            theirs = by_kind.get((_key(cell), against))
            if _kind(cell) not in BASELINES and theirs is not None:
                yield MatrixComparison(cell, theirs, against, ERROR_RATE)


def _kind(cell: Cell) -> str:
    return kind_in(cell.runs[0].representation)


def _key(cell: Cell) -> str:
    """Returns a key that is equal for cells that differ only in their representation."""
    return alike(cell.runs[0], {*SEED, *with_implied("representation")})
