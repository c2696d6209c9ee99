"""Merging results directories: intact records are copied; the sources are not changed.

A record is committed as usual, its files first and its manifest last, so an interrupted merge can
be repeated.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa

from jbench.errors import RequestError, WorkError
from jbench.names import one_of
from jbench.store.database import Results
from jbench.store.manifest import KINDS
from jbench.store.record import Record
from jbench.store.repair import Quarantine
from jbench.store.verify import Progress, examine, no_progress

TIMES = ("wall_time", "processor_time")
"""Columns that may differ between two computations of the same record."""

Outcome = Literal["copied", "replaced", "same", "kept", "refused"]
"""Outcome for a record: copied; replaced an unfinished one, which was set aside; the same except
for times; kept because the existing record is more complete; or refused."""


class Merged(NamedTuple):
    """Outcome for one record of a source.

    Attributes:
        record: kind and id; or the path of a source that can't be read.
        reason: why it was refused, as a sentence; otherwise empty.
    """

    record: str
    outcome: Outcome
    reason: str = ""


def merge(
    results: Results, sources: Sequence[Results], progress: Progress = no_progress
) -> list[Merged]:
    """Merges the sources, which are only read, into the results.

    Raises:
        RequestError: if a source contains no results, or is the destination.
    """
    for source in sources:
        _check_source(results, source)
    # Dependencies first.
    scanned = [(source, *source.scan(kind)) for kind in KINDS for source in sources]
    merged = [
        Merged(str(source.path), "refused", problem)
        for source, _, problems in scanned
        for problem in problems
    ]
    records = [(source, record) for source, records, _ in scanned for record in records]
    quarantine = Quarantine(results)
    with progress(len(records)) as show:
        for done, (source, record) in enumerate(records, 1):
            name = f"{record.kind} {record.id}"
            try:
                merged.append(Merged(name, _merge_one(results, source, record, quarantine)))
            except (WorkError, RequestError) as error:
                merged.append(Merged(name, "refused", str(error)))
            show(done)
    return merged


def _check_source(results: Results, source: Results) -> None:
    if not any((source.path / f"{kind}s").is_dir() for kind in KINDS):
        raise RequestError(
            f"{source.path} holds no results; name a directory with "
            f"{one_of(f'{kind}s' for kind in KINDS)} in it."
        )
    if source.path.resolve() == results.path.resolve():
        raise RequestError(f"{source.path} is the results directory itself; name another.")


def _merge_one(results: Results, source: Results, other: Record, quarantine: Quarantine) -> Outcome:
    """Copies a record if it is intact and needed."""
    faults = [f for f in examine(source, other.kind, other.id) if f.severity != "leftover"]
    if faults:
        raise WorkError(str(faults[0]))
    other.refresh()
    own = results.record(other.kind, other.id)
    with results.locked(other.kind, other.id) as existing:
        outcome: Outcome = "copied" if existing is None else _choice(existing, other)
        if outcome == "replaced":
            quarantine.take_record(own.path)
        if outcome in ("copied", "replaced"):
            own.copy_from(other)
    return outcome


def _choice(own: Record, other: Record) -> Outcome:
    """Returns the outcome for a record that exists already.

    Raises:
        WorkError: if their contents conflict.
    """
    finished = own.status == "finished", other.status == "finished"
    if finished == (True, False):
        return "kept"
    if finished == (False, True):
        return "replaced"
    if own.manifest.files == other.manifest.files:
        return "same"
    entries = (*own.manifest.files, *other.manifest.files)
    # Paths follow from the evaluations; older versions did not record them.
    tables = sorted({entry.table for entry in entries if entry.table not in (None, "paths")})
    differences = filter(None, (_difference(own, other, table) for table in tables))
    difference = next(differences, None)
    more = [other.rows(table) - own.rows(table) for table in tables]
    if difference is None and finished == (True, True):
        difference = _other_files(own, other) or ("another number of rows" if any(more) else None)
    if difference is None and not any(more):
        return "same"
    # Two states of the same work: the one with more rows is newer.
    if difference is None and min(more) >= 0:
        return "replaced"
    if difference is None and max(more) <= 0:
        return "kept"
    raise WorkError(
        f"{other.path} has the settings of {own.path}, but other content ("
        f"{difference or 'each has rows that the other has not'}); neither is changed."
    )


def _other_files(own: Record, other: Record) -> str | None:
    """Returns which files other than tables and checkpoints differ, or None."""
    contents = [
        {
            entry.name: entry.sha256
            for entry in record.manifest.files
            if entry.table is None and entry.role is None
        }
        for record in (own, other)
    ]
    names = sorted({name for name, _ in contents[0].items() ^ contents[1].items()})
    return f"in {', '.join(names)}" if names else None


def _difference(own: Record, other: Record, table: str) -> str | None:
    """Returns where the common rows of a table differ, except for times, or None."""
    first = 0
    for ours, theirs in _aligned(_rows(own, table), _rows(other, table)):
        if set(ours.column_names) != set(theirs.column_names):
            return f"other columns of {table}"
        for name in ours.column_names:
            if not _equal(ours[name], theirs[name]):
                return f"{name} of {table}, in rows {first} to {first + ours.num_rows - 1}"
        first += ours.num_rows
    return None


def _aligned(
    own: Iterator[pa.Table], other: Iterator[pa.Table]
) -> Iterator[tuple[pa.Table, pa.Table]]:
    """Yields pairs of equally long parts of two tables, up to the end of the shorter one."""
    ours, theirs = next(own, None), next(other, None)
    while ours is not None and theirs is not None:
        count = min(len(ours), len(theirs))
        yield ours.slice(0, count), theirs.slice(0, count)
        ours = ours.slice(count) if len(ours) > count else next(own, None)
        theirs = theirs.slice(count) if len(theirs) > count else next(other, None)


def _rows(record: Record, table: str) -> Iterator[pa.Table]:
    """Yields the rows of a table, file by file, without times."""
    for entry in record.parts(table):
        rows = record.rows_of(entry)
        yield rows.drop_columns([name for name in TIMES if name in rows.column_names])


def _equal(own: pa.ChunkedArray, other: pa.ChunkedArray) -> bool:
    """Returns whether two columns are equal; NaN equals NaN."""
    if own.equals(other):
        return True
    if not (own.type == other.type and pa.types.is_floating(own.type)):
        return False
    same_gaps = own.is_null().equals(other.is_null())
    return same_gaps and np.array_equal(own.to_numpy(), other.to_numpy(), equal_nan=True)
