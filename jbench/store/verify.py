"""Checking a results directory: manifests, the files that they list, and unlisted files.

Files are read in chunks by several threads, so memory use does not depend on their size or number.
Nothing is changed, and concurrent writers are not disturbed.
"""

import itertools
import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.store import files, flaws, locks
from jbench.store.database import Results
from jbench.store.manifest import KINDS, MANIFEST, FileEntry, Kind, VersionError
from jbench.store.record import Record
from jbench.store.tree import Folder, folder_at, walk

Severity = Literal["damaged", "leftover", "foreign", "warning"]
"""Severity of a finding: a record is damaged; no manifest lists a file; a record can't be checked,
because a newer jbench wrote it or reading fails; or a record is intact, with a warning.
"""

Progress = Callable[[int], AbstractContextManager[Callable[[int], None]]]
"""Takes the total of some work; during the work, yields a function that takes how much is done."""

_MAX_TRIES = 5  # for a record that changes during the check
_AHEAD = 16  # files submitted to the threads in advance

_REFERENCES: dict[Kind, tuple[str, Kind]] = {
    "encoder": ("dataset", "dataset"),
    "run": ("encoder", "encoder"),
    "evaluation": ("policy", "run"),
}
"""The setting of a kind that names another record, and that record's kind."""


class Finding(NamedTuple):
    """A problem in a results directory.

    Attributes:
        severity: see `Severity`.
        id: of the record, or the path at which a record would be.
        problem: clause to follow the path in a sentence.
    """

    severity: Severity
    kind: Kind
    id: str
    path: Path
    problem: str

    def __str__(self) -> str:
        return f"{self.path} {self.problem}."

    def to_json(self) -> dict[str, str]:
        """Returns the finding for a JSON document, where the severity is called `sort`."""
        return {
            "sort": self.severity,
            "kind": self.kind,
            "id": self.id,
            "path": str(self.path),
            "problem": self.problem,
        }


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
    findings: list[Finding]

    @property
    def faults(self) -> list[Finding]:
        """All findings except warnings."""
        return [finding for finding in self.findings if finding.severity != "warning"]


@dataclass
class _FolderCheck:
    """A folder, the findings so far, and its record if it has one."""

    folder: Folder
    findings: list[Finding]
    record: Record | None = None

    @property
    def intact(self) -> Record | None:
        """The record, if it is not damaged."""
        damaged = any(finding.severity == "damaged" for finding in self.findings)
        return None if damaged else self.record


def no_progress(total: int) -> AbstractContextManager[Callable[[int], None]]:
    """Shows nothing."""
    return nullcontext(lambda done: None)


def verify(results: Results, threads: int, progress: Progress = no_progress) -> Verified:
    """Checks a results directory; each thread reads a file, and the progress is in bytes."""
    checks = [check for kind in KINDS for check in _checks_of(results, kind)]
    _check_files(checks, threads, progress)
    checks = [_settled(results, check) for check in checks]
    records = [check.record for check in checks if check.record is not None]
    intact = {(own.kind, own.id) for check in checks if (own := check.intact) is not None}
    findings = []
    for check in checks:
        findings += _without_writers_files(check)
        if check.record is not None:
            findings += _warnings(check.record, intact)
    listed = sum(len(record.manifest.files) for record in records)
    return Verified(len(records), listed, sum(record.size for record in records), findings)


def examine(results: Results, kind: Kind, id: str) -> list[Finding]:
    """Checks one record, or a folder where one should be; without warnings.

    Unlisted files are reported even if the record is locked, since the caller may hold the lock.
    """
    check = _check_folder(results, kind, folder_at(results.path / f"{kind}s" / id))
    return _settled(results, _with_files(check)).findings


def _checks_of(results: Results, kind: Kind) -> list[_FolderCheck]:
    """Returns checks of all folders of a kind, without their files."""
    root = results.path / f"{kind}s"
    try:
        results.inside(root.name)
    except WorkError:
        problem = "leads out of the results directory; it is not used"
        return [_FolderCheck(Folder(root, ()), [Finding("foreign", kind, ".", root, problem)])]
    return [_check_folder(results, kind, folder) for folder in walk(root)]


def _check_folder(results: Results, kind: Kind, folder: Folder) -> _FolderCheck:
    """Checks a folder and its manifest, without the files that it lists."""
    id = folder.path.relative_to(results.path / f"{kind}s").as_posix()
    manifest = folder.path / MANIFEST
    if folder.problem is not None:
        return _FolderCheck(folder, [Finding("foreign", kind, id, folder.path, folder.problem)])
    if not folder.is_record:
        return _FolderCheck(folder, _unlisted_files(kind, id, folder, set()))
    try:
        record = results.find(kind, id)
    except (WorkError, RequestError) as error:
        foreign = isinstance(error, VersionError | files.UnreadableError)
        severity: Severity = "foreign" if foreign else "damaged"
        problem = str(error).removeprefix(f"{manifest} ").removesuffix(".")
        return _FolderCheck(folder, [Finding(severity, kind, id, manifest, problem)])
    if record is None:  # removed in the meantime
        return _FolderCheck(folder, [])
    listed = {MANIFEST, *(entry.name for entry in record.manifest.files)}
    findings = _unlisted_files(kind, id, folder, listed)
    flaw = flaws.of_settings(record)
    if flaw is not None:
        findings.append(Finding("damaged", kind, id, manifest, flaw))
    return _FolderCheck(folder, findings, record)


def _settled(results: Results, check: _FolderCheck) -> _FolderCheck:
    """Repeats a check with findings if its record has changed since."""
    for _ in range(_MAX_TRIES):
        if not check.findings or check.record is None or not check.record.refresh():
            return check
        folder = folder_at(check.folder.path)
        check = _with_files(_check_folder(results, check.record.kind, folder))
    check.findings = []  # the record changes faster than it can be checked
    return check


def _unlisted_files(kind: Kind, id: str, folder: Folder, listed: set[str]) -> list[Finding]:
    """Returns findings for the files of a folder that no manifest lists."""
    return [
        Finding("leftover", kind, id, folder.path / name, "is listed by no manifest")
        for name in folder.names
        if name not in listed and name != locks.LOCK and os.path.lexists(folder.path / name)
    ]


def _without_writers_files(check: _FolderCheck) -> list[Finding]:
    """Returns the findings without unlisted files that a concurrent writer has created."""
    unlisted = [finding for finding in check.findings if finding.severity == "leftover"]
    if not unlisted:
        return check.findings
    if locks.is_held(check.folder.path):
        return [finding for finding in check.findings if finding.severity != "leftover"]
    # A writer that has ended since has listed or removed them.
    listed = set()
    if check.record is not None and check.record.refresh():
        listed = {entry.name for entry in check.record.manifest.files}
    return [
        finding
        for finding in check.findings
        if finding.severity != "leftover"
        or (finding.path.name not in listed and os.path.lexists(finding.path))
    ]


def _check_files(checks: Sequence[_FolderCheck], threads: int, progress: Progress) -> None:
    """Checks the files of all records with several threads."""
    entries = [
        (check, check.record, entry)
        for check in checks
        if check.record is not None
        for entry in check.record.manifest.files
    ]
    total, done = sum(entry.bytes for *_, entry in entries), 0
    pending: deque[Future[Finding | None]] = deque()
    with progress(total) as show, ThreadPoolExecutor(threads) as pool:
        ahead = iter(entries)
        for check, _, entry in entries:
            for _, record, next_entry in itertools.islice(ahead, _AHEAD - len(pending)):
                pending.append(pool.submit(_flaw, record, next_entry))
            finding = pending.popleft().result()
            check.findings += [] if finding is None else [finding]
            done += entry.bytes
            show(done)


def _with_files(check: _FolderCheck) -> _FolderCheck:
    """Completes a check with the files of its record."""
    _check_files([check], 1, no_progress)
    return check


def _flaw(record: Record, entry: FileEntry) -> Finding | None:
    """Returns a finding if a file of a record is damaged or unreadable."""
    path = record.path / entry.name
    transient = False
    try:
        problem = flaws.of_file(record, entry)
    except OSError as error:
        transient, problem = files.is_transient(error), str(error.strerror or error)
    if problem is None:
        return None
    if transient:
        return Finding("foreign", record.kind, record.id, path, f"can't be read ({problem})")
    return Finding("damaged", record.kind, record.id, path, f"is damaged ({problem})")


def _warnings(record: Record, intact: Collection[tuple[Kind, str]]) -> Iterator[Finding]:
    """Yields warnings about a record."""
    manifest = record.path / MANIFEST
    setting, kind = _REFERENCES.get(record.kind, ("", record.kind))
    named = str(record.settings.get(setting))
    if named != "None" and not _is_self_contained(record, named) and (kind, named) not in intact:
        problem = f"names the {kind} {named}, which is not intact in these results"
        yield Finding("warning", record.kind, record.id, manifest, problem)
    for what in ("created", "updated"):
        date = getattr(record.manifest, what)
        if flaw := flaws.of_date(date):
            problem = f"was {what} {date!r}: {flaw}"
            yield Finding("warning", record.kind, record.id, manifest, problem)


def _is_self_contained(record: Record, named: str) -> bool:
    """Returns whether a record is usable without the record that its settings name.

    A finished encoder is. An evaluation depends on a run of these results only if its policy is the
    id of a run, and not a shipped one, whose name begins with `reference/`.
    """
    if record.kind == "encoder":
        return record.status == "finished"
    return record.kind == "evaluation" and ("/" not in named or named.startswith("reference/"))
