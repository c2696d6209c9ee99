"""Checking a results directory: manifests, their files, and files that no manifest lists.

Files are read in chunks, so memory use does not depend on their size or number. A check changes
nothing, and does not disturb concurrent writers.
"""

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from jbench.settings.base import settings_hash
from jbench.store import locks, record_files, schema
from jbench.store.database import Results
from jbench.store.files import DamagedError, RecordError, Sort
from jbench.store.folder import Folder
from jbench.store.manifest import KINDS, MANIFEST, FileEntry, RecordKind
from jbench.store.record import Record
from jbench.store.rows import make_row
from jbench.store.weights import has_other_encoder

ShowProgress = Callable[[int], contextlib.AbstractContextManager[Callable[[int], None]]]
"""Takes the total of some work; during the work, yields a function that takes how much is done."""

_MAX_TRIES = 5  # for a record that changes during the check


class Flaw(NamedTuple):
    """What is wrong: `problem` follows the path in a sentence; `id` is a record's or a folder's."""

    sort: Sort
    kind: RecordKind
    id: str
    path: Path
    problem: str

    def __str__(self) -> str:
        """The flaw as a sentence."""
        return f"{self.path} {self.problem}."


class Verified(NamedTuple):
    """What a check of a results directory has found.

    Attributes:
        records: number of records whose manifests can be read.
        files: number of files that these list.
        bytes: of these files.
        findings: what is wrong, and warnings.
        left_out: number of records some of whose files are left out of an installed package.
    """

    records: int
    files: int
    bytes: int
    findings: list[Flaw]
    left_out: int = 0

    @property
    def faults(self) -> list[Flaw]:
        """All findings except warnings."""
        return [flaw for flaw in self.findings if flaw.sort != "warning"]


def no_progress(total: int) -> contextlib.AbstractContextManager[Callable[[int], None]]:
    """Shows nothing."""
    return contextlib.nullcontext(lambda done: None)


def verify(results: Results, threads: int, progress: ShowProgress = no_progress) -> Verified:
    """Checks a results directory; each thread checks a record, and the progress is in folders."""
    walked = [*chain.from_iterable(map(results.walk, KINDS))]
    checked = []
    with progress(len(walked)) as show, ThreadPoolExecutor(threads) as pool:
        for outcome in pool.map(lambda folder: _check_beside_writers(results, folder), walked):
            checked.append(outcome)
            show(len(checked))

    records = [record for record, _ in checked if record is not None]
    intact = {(record.kind, record.id) for record in records}
    for flaw in chain.from_iterable(flaws for _, flaws in checked):
        if flaw.sort == "damaged":
            intact.discard((flaw.kind, flaw.id))

    findings = list[Flaw]()
    for record, flaws in checked:
        findings += flaws
        if record is not None:
            findings += _warnings(record, intact, results)

    entries = chain.from_iterable(record.manifest.files for record in records)
    sizes = [entry.bytes for entry in entries]
    left_out = sum(bool(record.left_out) for record in records)
    return Verified(len(records), len(sizes), sum(sizes), findings, left_out)


def examine(results: Results, kind: RecordKind, id: str) -> tuple[Record | None, list[Flaw]]:
    """Returns a record, if it can be read, and what is wrong with its folder; without warnings.

    Unlisted files are reported even if the record is locked, since the caller may hold the lock.
    """
    for _ in range(_MAX_TRIES):
        record, flaws = _check(results.found(kind, id))
        if not flaws or record is None or not record.refresh():
            return record, flaws
    return record, []  # it changes faster than it can be checked


def _check_beside_writers(results: Results, folder: Folder) -> tuple[Record | None, list[Flaw]]:
    """Checks a record again if it may have been written meanwhile."""
    record, flaws = _check(folder)
    if flaws:
        was_held = locks.is_held(folder.path)
        record, flaws = examine(results, folder.kind, folder.id)
        if was_held or locks.is_held(folder.path):  # the writer will list or remove its files
            flaws = [flaw for flaw in flaws if flaw.sort != "leftover"]
    return record, flaws


def _check(folder: Folder) -> tuple[Record | None, list[Flaw]]:
    """Reads the record of a folder, if any; returns also what is wrong with its files."""
    errors = list[RecordError]()
    record: Record | None = None
    try:
        record = Record.in_folder(folder)
        if record is not None:
            make_row(record)
            expected = settings_hash(record.settings)
            if not record.id.endswith(f"-{expected}"):
                problem = f"has settings of the hash {expected}, not those that its id was made of"
                raise DamagedError(record.path / MANIFEST, problem)
    except RecordError as error:
        errors.append(error)

    if record is not None:
        for entry in record.manifest.files:
            try:
                record_files.check(record.path, entry, _expected_columns(record, entry))
            except RecordError as error:
                errors.append(error)

    kind = folder.kind
    id = folder.id
    flaws = [Flaw(error.sort, kind, id, error.path, error.problem) for error in errors]
    if record is not None or MANIFEST not in folder.names:
        named = set[str]()
        if record is not None:
            named = {entry.name for entry in record.manifest.files}

        for name in sorted({*folder.names} - named - {MANIFEST, locks.LOCK}):
            flaws.append(Flaw("leftover", kind, id, folder.path / name, "is listed by no manifest"))

    return record, flaws


def _expected_columns(record: Record, entry: FileEntry) -> Sequence[str]:
    """Returns the columns that a file must have: none if it is no table, or an old one."""
    columns = schema.FILES.get(entry.table or "")
    if columns is None or record.manifest.is_old:
        return ()

    names: list[str] = columns.names
    return names


def _warnings(
    record: Record, intact: Collection[tuple[RecordKind, str]], results: Results
) -> Iterator[Flaw]:
    """Yields what is odd about an intact record: its origin is missing or another, or its dates."""
    problems = [*_missing_origin(record, intact), *_odd_dates(record)]
    if record.kind == "run" and has_other_encoder(record, results):
        problems.append(
            f"is of a run that was trained with another encoder {record.settings['encoder']} than "
            "the one in these results, which has the same settings and other weights"
        )

    for problem in problems:
        yield Flaw("warning", record.kind, record.id, record.path / MANIFEST, problem)


def _missing_origin(record: Record, intact: Collection[tuple[RecordKind, str]]) -> Iterator[str]:
    """Yields a clause if the record without which this one is of no use is missing or damaged."""
    origin = record.manifest.origin
    if record.kind == "encoder" and record.is_finished:
        return  # it does not need its dataset any more
    if origin is not None and origin not in intact:
        yield f"names the {origin.kind} {origin.id}, which is not intact in these results"


def _odd_dates(record: Record) -> Iterator[str]:
    """Yields a clause for each date of a manifest that is none, or is in the future."""
    for event in ("created", "updated"):
        date = getattr(record.manifest, event)
        try:
            # Clocks of different machines differ a little.
            if datetime.fromisoformat(date) > datetime.now(UTC) + timedelta(hours=1):
                yield f"was {event} {date!r}: in the future, so that its clock or this one is wrong"
        except (ValueError, TypeError):
            yield f"was {event} {date!r}: no date with a time zone"
