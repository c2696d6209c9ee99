"""Following runs: their rows as they are committed."""

import contextlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from jbench.errors import WorkError
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.manifest import MANIFEST
from jbench.store.record import Record
from jbench.store.rows import Row, finite
from jbench.store.run_line import make_line

POLL_SECONDS = 2.0
"""Seconds between two reads of the manifests."""


class Change(NamedTuple):
    """What a commit has changed in a run.

    Attributes:
        record: of the run.
        is_new: whether the run is seen for the first time or has started over; rows of it that
            were yielded before are then void.
        status_changed: whether its status is another one; also true if it is new.
        rows: the new rows, each with its table, in the order of control steps; numbers that are
            not finite are None.
    """

    record: Record
    is_new: bool
    status_changed: bool
    rows: list[tuple[str, Row]]


class Follower:
    """Yields each committed row of runs once. It only reads; any number may run beside writers."""

    def __init__(self, results: Results, filters: Mapping[str, Collection[Any]]) -> None:
        """Follows the runs whose lines (`make_line`) have the allowed values when first seen."""
        self._results = results
        self._filters = filters
        # By id: the record whose rows were yielded, and the stamp of its manifest.
        self._seen: dict[str, Record] = {}
        self._stamps: dict[str, tuple[int, ...] | None] = {}
        self._reported: set[str] = set()

    def changes(self) -> Iterator[Change | str]:
        """Yields the changes since the last call, and a sentence for each damaged run, once."""
        for folder in self._results.walk("run"):
            now = stamp(folder.path / MANIFEST)
            seen = self._seen.get(folder.id)
            if now is not None and now == self._stamps.get(folder.id):
                continue
            record: Record | None = None
            change: Change | None = None
            try:
                record = Record.in_folder(folder)
                if record and (seen or make_line(record).matches(self._filters)):
                    change = record.reading(partial(_change, record, seen))
            except WorkError as error:
                if str(error) not in self._reported:
                    self._reported.add(str(error))
                    yield str(error)
                continue

            self._stamps[folder.id] = now
            if record is not None and change is not None:
                self._seen[folder.id] = record
                if change.status_changed or change.rows:
                    yield change


def grouped(rows: Sequence[tuple[str, Row]]) -> Iterator[tuple[str, list[Row]]]:
    """Yields the table and the rows of an episode (one), an evaluation, or a step's metrics."""
    number = {"episodes": "episode", "evaluations": "evaluation", "metrics": "control_steps"}
    for (table, _), group in groupby(rows, lambda row: (row[0], row[1][number[row[0]]])):
        yield table, [row for _, row in group]


def stamp(manifest: Path) -> tuple[int, ...] | None:
    """Returns what each commit changes, since it renames a new file to this name."""
    with contextlib.suppress(OSError):
        stat = manifest.stat()
        return stat.st_ino, stat.st_mtime_ns, stat.st_size
    return None


def _change(record: Record, before: Record | None) -> Change:
    """Returns what a run has changed since it was seen."""
    if before is not None and (
        record.manifest.created != before.manifest.created
        or any(record.rows(table) < before.rows(table) for table in schema.LOG_TABLES)
    ):
        before = None  # it has started over

    status_changed = before is None or record.status != before.status
    # The rows that the run did not have before; only the files that have them are read.
    rows: list[tuple[str, Row]] = []
    for table, columns in schema.LOG_TABLES.items():
        known = 0 if before is None else before.rows(table)
        first = 0
        parts = [columns.empty_table()]
        for entry in record.parts(table):
            if first + entry.rows > known:
                part = record.read_part(entry, columns)
                parts.append(part.slice(max(0, known - first)))
            first += entry.rows

        rows += [(table, finite(row)) for row in pa.concat_tables(parts).to_pylist()]

    rows.sort(key=lambda row: row[1]["control_steps"] or 0)
    return Change(record, before is None, status_changed, rows)
