"""Checking a results directory: manifests, the files that they list, and unlisted files.

Files are read in chunks, so memory use does not depend on their size or number. Nothing is changed,
and concurrent writers are not disturbed.
"""

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from jbench.settings.base import settings_hash
from jbench.store import locks
from jbench.store.database import Folder, Results
from jbench.store.flaws import DamagedError, RecordError, Sort
from jbench.store.manifest import KINDS, MANIFEST, Kind
from jbench.store.record import Record
from jbench.store.rows import make_row

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
        files: number of the files that they list.
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
    """Checks a results directory; each thread checks a record, and the progress is in folders."""
    folders = [folder for kind in KINDS for folder in results.walk(kind)]
    checked: list[tuple[Record | None, list[Flaw]]] = []
    with progress(len(folders)) as show, ThreadPoolExecutor(threads) as pool:
        for outcome in pool.map(lambda folder: _check_beside_writers(results, folder), folders):
            checked.append(outcome)
            show(len(checked))
    records = [record for record, _ in checked if record is not None]
    findings = [flaw for _, flaws in checked for flaw in flaws]
    damaged = {(flaw.kind, flaw.id) for flaw in findings if flaw.sort == "damaged"}
    intact = {(record.kind, record.id) for record in records} - damaged
    for record, flaws in checked:
        flaws += () if record is None else _warnings(record, intact)
    sizes = [entry.bytes for record in records for entry in record.manifest.files]
    findings = [flaw for _, flaws in checked for flaw in flaws]
    return Verified(len(records), len(sizes), sum(sizes), findings)


def examine(results: Results, kind: Kind, id: str) -> tuple[Record | None, list[Flaw]]:
    """Returns a record, if it can be read, and what is wrong with its folder; without warnings.

    Unlisted files are reported even if the record is locked, since the caller may hold the lock.
    """
    for _ in range(_MAX_TRIES):
        record, flaws = _check(results.look(kind, id))
        if not flaws or record is None or not record.refresh():
            return record, flaws
    return record, []  # it changes faster than it can be checked


def _check_beside_writers(results: Results, folder: Folder) -> tuple[Record | None, list[Flaw]]:
    """Examines a folder, in which another process may be writing."""
    record, flaws = _check(folder)
    if flaws:
        was_held = locks.is_held(folder.path)
        record, flaws = examine(results, folder.kind, folder.id)
        if was_held or locks.is_held(folder.path):  # the writer will list or remove its files
            flaws = [flaw for flaw in flaws if flaw.sort != "leftover"]
    return record, flaws


def _check(folder: Folder) -> tuple[Record | None, list[Flaw]]:
    """Returns the record of a folder, and what is wrong with it, its files and unlisted ones."""
    record, errors = None, list[RecordError]()
    try:
        record = folder.read()
        if record is not None:
            _check_settings(record)
    except RecordError as error:
        errors.append(error)
    listed: set[str] = set()
    if record is not None:
        listed |= {entry.name for entry in record.manifest.files}
        for entry in record.manifest.files:
            try:
                record.check(entry)
            except RecordError as error:
                errors.append(error)
    flaws = [Flaw(e.sort, folder.kind, folder.id, e.path, e.problem) for e in errors]
    if record is not None or MANIFEST not in folder.names:
        for name in sorted({*folder.names} - listed - {MANIFEST, locks.LOCK}):
            path = folder.path / name
            flaws.append(Flaw("leftover", folder.kind, folder.id, path, "is listed by no manifest"))
    return record, flaws


def _check_settings(record: Record) -> None:
    """Raises a `DamagedError` if a record's settings are invalid or do not match its id."""
    make_row(record)
    expected = settings_hash(record.settings)
    if not record.id.endswith(f"-{expected}"):
        problem = f"has settings of the hash {expected}, not those that its id was made of"
        raise DamagedError(record.path / MANIFEST, problem)


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
        # Clocks of different machines differ a little.
        if datetime.fromisoformat(text) > datetime.now(UTC) + timedelta(hours=1):
            return "in the future, so that its clock or this one is wrong"
    except (ValueError, TypeError):
        return "no date with a time zone"
    return None
