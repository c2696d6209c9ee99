"""Checking a results directory: manifests, the files that they list, and unlisted files.

Files are read in chunks by several threads, so memory use does not depend on their size or number.
Nothing is changed, and concurrent writers are not disturbed.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from jbench.settings.base import settings_hash
from jbench.store import listed, locks, schema
from jbench.store.database import Results
from jbench.store.flaws import DamagedError, RecordError, Sort, UnreadableError
from jbench.store.manifest import KINDS, MANIFEST, FileEntry, Kind
from jbench.store.record import Record
from jbench.store.rows import make_row
from jbench.store.scan import Folder, look, walk

Progress = Callable[[int], AbstractContextManager[Callable[[int], None]]]
"""Takes the total of some work; during the work, yields a function that takes how much is done."""

_MAX_TRIES = 5  # for a record that changes during the check

_REFERENCES: dict[Kind, tuple[str, Kind]] = {
    "encoder": ("dataset", "dataset"),
    "run": ("encoder", "encoder"),
    "evaluation": ("policy", "run"),
}
"""The setting of a kind that names another record, and that record's kind."""


class Flaw(NamedTuple):
    """A problem in a results directory.

    Attributes:
        id: of the record, or the path at which a record would be.
        problem: clause to follow the path in a sentence.
    """

    sort: Sort
    kind: Kind
    id: str
    path: Path
    problem: str

    def __str__(self) -> str:
        return f"{self.path} {self.problem}."


class Verified(NamedTuple):
    """Result of checking a results directory.

    Attributes:
        records: number of readable manifests.
        files: number of listed files.
        bytes: total size of these files.
        findings: record by record.
    """

    records: int
    files: int
    bytes: int
    findings: list[Flaw]

    @property
    def faults(self) -> list[Flaw]:
        """All findings except warnings."""
        return [flaw for flaw in self.findings if flaw.sort != "warning"]


def no_progress(total: int) -> AbstractContextManager[Callable[[int], None]]:
    """Shows nothing."""
    return nullcontext(lambda done: None)


def verify(results: Results, threads: int, progress: Progress = no_progress) -> Verified:
    """Checks a results directory; each thread reads a file, and the progress is in bytes."""
    folders = [folder for kind in KINDS for folder in walk(results.path, kind)]
    checked = [_check_folder(folder) for folder in folders]
    records = [record for record, _ in checked if record is not None]
    suspects = {(flaw.kind, flaw.id) for _, flaws in checked for flaw in flaws}
    suspects |= {(flaw.kind, flaw.id) for flaw in _check_files(records, threads, progress)}
    faults = {(kind, id): _check_again(results, kind, id) for kind, id in suspects}
    damaged = {key for key, flaws in faults.items() if any(f.sort == "damaged" for f in flaws)}
    intact = {(record.kind, record.id) for record in records} - damaged
    findings: list[Flaw] = []
    for folder, (record, _) in zip(folders, checked, strict=True):
        findings += faults.get((folder.kind, folder.id), ())
        findings += () if record is None else _warnings(record, intact)
    sizes = [entry.bytes for record in records for entry in record.manifest.files]
    return Verified(len(records), len(sizes), sum(sizes), findings)


def examine(results: Results, kind: Kind, id: str) -> list[Flaw]:
    """Checks one record, or a folder where one should be; without warnings.

    Unlisted files are reported even if the record is locked, since the caller may hold the lock.
    """
    for _ in range(_MAX_TRIES):
        record, flaws = _check_folder(look(results.path, kind, id))
        if record is not None:
            flaws += _check_files([record], 1, no_progress)
        if not flaws or record is None or not record.refresh():
            return flaws
    return []  # the record changes faster than it can be checked


def _check_again(results: Results, kind: Kind, id: str) -> list[Flaw]:
    """Examines a record that a writer may have changed during the first check."""
    path = results.path / f"{kind}s" / id
    is_written = locks.is_held(path)
    flaws = examine(results, kind, id)
    if is_written or locks.is_held(path):  # the writer will list or remove its files
        return [flaw for flaw in flaws if flaw.sort != "leftover"]
    return flaws


def _check_folder(folder: Folder) -> tuple[Record | None, list[Flaw]]:
    """Returns the record of a folder, and what is wrong with all but the files that it lists."""
    kind, id = folder.kind, folder.id
    record, flaws = None, []
    try:
        record = folder.read()
        if record is not None:
            _check_settings(record)
    except RecordError as error:
        foreign = isinstance(error, UnreadableError)
        problem = error.problem_with_advice if foreign else error.problem
        flaws.append(Flaw(error.sort, kind, id, error.path, problem))
    if record is not None or MANIFEST not in folder.names:
        entries = () if record is None else record.manifest.files
        unlisted = {*folder.names} - {MANIFEST, locks.LOCK, *(entry.name for entry in entries)}
        for name in sorted(unlisted):
            path = folder.path / name
            flaws.append(Flaw("leftover", kind, id, path, "is listed by no manifest"))
    return record, flaws


def _check_settings(record: Record) -> None:
    """Raises a `DamagedError` if a record's settings are invalid or do not match its id."""
    make_row(record)
    expected = settings_hash(record.settings)
    if not record.id.endswith(f"-{expected}"):
        problem = f"has settings of the hash {expected}, not those that its id was made of"
        raise DamagedError(record.path / MANIFEST, problem)


def _check_files(records: Sequence[Record], threads: int, progress: Progress) -> list[Flaw]:
    """Returns what is wrong with the files that records list."""
    entries = [(record, entry) for record in records for entry in record.manifest.files]
    flaws, done = [], 0
    total = sum(entry.bytes for _, entry in entries)
    with progress(total) as show, ThreadPoolExecutor(threads) as pool:
        for (_, entry), flaw in zip(entries, pool.map(_check_file, entries), strict=True):
            flaws += [] if flaw is None else [flaw]
            done += entry.bytes
            show(done)
    return flaws


def _check_file(listed_file: tuple[Record, FileEntry]) -> Flaw | None:
    record, entry = listed_file
    columns = None if record.manifest.is_old else schema.FILES.get(entry.table or "")
    try:
        listed.check(record.path, entry, () if columns is None else columns.names)
    except RecordError as error:
        return Flaw(error.sort, record.kind, record.id, error.path, error.problem)
    return None


def _warnings(record: Record, intact: Collection[tuple[Kind, str]]) -> Iterator[Flaw]:
    """Yields warnings about a record."""
    problems = []
    setting, kind = _REFERENCES.get(record.kind, ("", record.kind))
    named = str(record.settings.get(setting))
    if named != "None" and not _is_self_contained(record, named) and (kind, named) not in intact:
        problems.append(f"names the {kind} {named}, which is not intact in these results")
    for what in ("created", "updated"):
        date = getattr(record.manifest, what)
        if reason := _check_date(date):
            problems.append(f"was {what} {date!r}: {reason}")
    for problem in problems:
        yield Flaw("warning", record.kind, record.id, record.path / MANIFEST, problem)


def _is_self_contained(record: Record, named: str) -> bool:
    """Returns whether a record is usable without the record that its settings name.

    A finished encoder is. An evaluation depends on a run of these results only if its policy is the
    id of a run, and not a shipped one, whose name begins with `reference/`.
    """
    if record.kind == "encoder":
        return record.status == "finished"
    return record.kind == "evaluation" and ("/" not in named or named.startswith("reference/"))


def _check_date(text: str) -> str | None:
    """Returns a problem of a date of a manifest, or None."""
    try:
        date = datetime.fromisoformat(text)
        # Clocks of different machines differ a little.
        if date > datetime.now(UTC) + timedelta(hours=1):
            return "in the future, so that its clock or this one is wrong"
    except (ValueError, TypeError):
        return "no date with a time zone"
    return None
