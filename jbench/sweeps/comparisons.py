"""Comparisons of a matrix: those that its file lists, or each representation with the baselines."""

from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BeforeValidator

from jbench.errors import RequestError
from jbench.names import kind_of, known
from jbench.report.analysis.verdicts import BASELINES
from jbench.settings.alike import SEED, alike, with_implied
from jbench.settings.base import Count, Settings, validated, whole
from jbench.statistics.sequential import BLOCK, ERROR_RATE
from jbench.sweeps.cell import Cell
from jbench.sweeps.matrix_file import COMPARISON, named, read_content

Claim = Literal["a", "c"]
"""What is compared: the final return (a), or the mean return over the run (c)."""

_Count = Annotated[Count, BeforeValidator(whole)]


class Planned(Settings):
    """An entry of the key `comparison` of a matrix file; `docs/deciding.md` explains the keys."""

    task: str
    algo: str
    first: str
    second: str
    claim: Claim = "a"
    share: float | None = None
    max_seeds: _Count | None = None
    steps: _Count | None = None


class Comparison(NamedTuple):
    """Two cells that differ only in their representation.

    Attributes:
        ours: cell of the first representation.
        theirs: cell of the second one.
        against: name of the second representation.
        share: of the error rate, before other comparisons pass theirs on.
        claim: what is compared.
        max_seeds: maximum number of seeds per cell; None for that of the command.
    """

    ours: Cell
    theirs: Cell
    against: str
    share: float
    claim: Claim = "a"
    max_seeds: int | None = None

    @property
    def name(self) -> str:
        """Name in tables."""
        cell = self.ours
        name = f"{cell.task} {cell.algo} {cell.representation} against {self.against}"
        return name if self.claim == "a" else f"{name}, over the run"

    @property
    def claims(self) -> tuple[str, str]:
        """What a user types for all comparisons of this representation, and for this one only."""
        return self.ours.representation, f"{self.ours.representation}/{self.against}"


def read_comparisons(name: str) -> list[Planned]:
    """Returns the comparisons that a matrix file lists; none if it leaves the choice to jbench.

    Args:
        name: see `matrix.read_matrix`.

    Raises:
        RequestError: if an entry is invalid.
    """
    entries = read_content(name).get(COMPARISON, [])
    if not (isinstance(entries, list) and all(isinstance(entry, dict) for entry in entries)):
        with named(name):
            raise RequestError(
                f"{COMPARISON} is an array of tables: write [[{COMPARISON}]] above each."
            )
    planned = []
    for n, entry in enumerate(entries, 1):
        with named(f"{name}, {COMPARISON} {n}"):
            planned.append(_planned(entry))
    with named(name):
        _shares(planned)
    return planned


def comparisons(
    cells: Sequence[Cell], planned: Sequence[Planned] = (), claims: Collection[str] = ()
) -> list[Comparison]:
    """Returns the planned comparisons, or those of each reduced representation with each baseline.

    A planned comparison has its share of the error rate whether or not the others are requested;
    the others divide the whole rate equally among those that are requested.

    Args:
        claims: representations such as `dae12`, or pairs such as `dae12/full`; empty for all.

    Raises:
        RequestError: if there are no comparisons, a claim matches none of them, or the cells have
            not exactly one pair for a planned comparison.
    """
    every = _found(cells, planned) if planned else list(_with_baselines(cells))
    if not every:
        raise RequestError(
            "No two configurations of this matrix differ only in a representation and full or "
            "scaled, so there is nothing to decide; leave --until-decided out."
        )
    names = list(dict.fromkeys(name for one in every for name in one.claims))
    for claim in claims:
        known("comparison", claim, names)
    chosen = [one for one in every if not claims or {*one.claims} & {*claims}]
    if planned:
        return chosen
    return [one._replace(share=ERROR_RATE / len(chosen)) for one in chosen]


def _planned(entry: dict[str, Any]) -> Planned:
    for key in entry:
        known(f"key of [[{COMPARISON}]]", key, tuple(Planned.model_fields))
    for key, field in Planned.model_fields.items():
        if field.is_required() and key not in entry:
            raise RequestError(f'the key {key} is missing; write {key} = "…".')
    if isinstance(entry.get("claim"), str):
        known("claim", entry["claim"], get_args(Claim))
    one = validated(Planned, f"[[{COMPARISON}]]", **entry)
    if one.first == one.second:
        raise RequestError(f"first and second are both {one.first}; name two representations.")
    if one.share is not None and one.share <= 0:
        raise RequestError(f"share is {one.share:g}; write a number above 0, such as 0.01.")
    if one.max_seeds is not None and one.max_seeds % BLOCK:
        raise RequestError(f"max_seeds is {one.max_seeds}; write a multiple of {BLOCK}.")
    return one


def _shares(planned: Sequence[Planned]) -> list[float]:
    """Returns the shares of planned comparisons; those without one divide the rest equally."""
    given = sum(one.share or 0 for one in planned)
    rest = sum(one.share is None for one in planned)
    if given > ERROR_RATE + 1e-9 or (rest and given > ERROR_RATE - 1e-9):
        left = f", and {rest} without a share need a rest" if rest else ""
        raise RequestError(
            f"the shares of the comparisons add up to {given:g}{left}; together they have "
            f"{ERROR_RATE:g}, so write smaller ones."
        )
    return [(ERROR_RATE - given) / rest if one.share is None else one.share for one in planned]


def _found(cells: Sequence[Cell], planned: Sequence[Planned]) -> list[Comparison]:
    """Returns the planned comparisons with their cells."""
    found: list[Comparison] = []
    for n, (one, share) in enumerate(zip(planned, _shares(planned), strict=True), 1):
        with named(f"{COMPARISON} {n}"):
            pair = _pair(cells, one)
            if any(
                (*pair, one.claim) == (other.ours, other.theirs, other.claim) for other in found
            ):
                raise RequestError(f"{one.first} against {one.second} is listed twice.")
            found.append(Comparison(*pair, one.second, share, one.claim, one.max_seeds))
    return found


def _pair(cells: Sequence[Cell], one: Planned) -> tuple[Cell, Cell]:
    """Returns the two cells of a planned comparison."""
    known("task", one.task, tuple(dict.fromkeys(cell.task for cell in cells)))
    cells = [cell for cell in cells if cell.task == one.task]
    known(f"algorithm on {one.task}", one.algo, tuple(dict.fromkeys(cell.algo for cell in cells)))
    cells = [cell for cell in cells if cell.algo == one.algo]
    where = f"representation of {one.algo} on {one.task}"
    for name in (one.first, one.second):
        known(where, name, tuple(dict.fromkeys(name for cell in cells for name in _names(cell))))
    pairs = [
        (ours, theirs)
        for ours in cells
        for theirs in cells
        if one.first in _names(ours)
        and one.second in _names(theirs)
        and one.steps in (None, ours.runs[0].steps)
        and _key(ours) == _key(theirs)
    ]
    both = f"{one.first} and {one.second} of {one.algo} on {one.task}"
    if not pairs:
        steps = "" if one.steps is None else f" with {one.steps} control steps"
        raise RequestError(
            f"the matrix has no {both}{steps} that differ only in their representation; give both "
            "the same settings."
        )
    if len(pairs) > 1:
        raise RequestError(
            f"the matrix has {both} with {len(pairs)} settings; write the steps = … to compare."
        )
    return pairs[0]


def _names(cell: Cell) -> tuple[str, str]:
    """Returns the representation of a cell as typed, and with its size."""
    return cell.representation, cell.runs[0].representation


def _with_baselines(cells: Sequence[Cell]) -> Iterator[Comparison]:
    by_kind = {(_key(cell), _kind(cell)): cell for cell in cells}
    for cell in cells:
        for against in BASELINES:
            theirs = by_kind.get((_key(cell), against))
            if _kind(cell) not in BASELINES and theirs is not None:
                yield Comparison(cell, theirs, against, ERROR_RATE)


def _kind(cell: Cell) -> str:
    return kind_of(cell.runs[0].representation)


def _key(cell: Cell) -> str:
    """Returns a key that is equal for cells that differ only in their representation."""
    return alike(cell.runs[0], {*SEED, *with_implied("representation")})
