"""Moving damaged records and unlisted files to a quarantine directory; nothing is deleted.

    results/set-aside/2026-11-21T09-06-01Z/runs/face_direction/...

All files of a damaged record are moved, its manifest first. The record then no longer exists, and
the command that made it makes it again. Its lock stays, since another process may hold it.
"""

import contextlib
import itertools
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.store import files, locks
from jbench.store.database import Results
from jbench.store.manifest import MANIFEST, Kind
from jbench.store.provenance import shell_command
from jbench.store.tree import folder_at
from jbench.store.verify import Finding, examine

SET_ASIDE = "set-aside"


class Repaired(NamedTuple):
    """Result of a repair or a dry run.

    Attributes:
        moved: (source, destination) pairs in order.
        left: a sentence for each problem that was not repaired.
        commands: make the moved records again, as far as their manifests are readable.
    """

    moved: list[tuple[Path, Path]]
    left: list[str]
    commands: list[str]


class Quarantine:
    """Quarantine directory, created on first use."""

    def __init__(self, results: Results, dry_run: bool = False) -> None:
        """Chooses a new directory; in a dry run nothing is moved."""
        self.moved: dict[Path, Path] = {}
        self.dry_run = dry_run
        self._results = results
        root, now = results.inside(SET_ASIDE), datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
        # The clock may have been set back.
        names = itertools.chain((now,), (f"{now}-{n}" for n in itertools.count(2)))
        self.path = next(root / name for name in names if not (root / name).exists())

    def take(self, path: Path) -> None:
        """Moves a file or directory, keeping its path relative to the results."""
        to = self.path / path.relative_to(self._results.path)
        if path in self.moved:
            return
        if not self.dry_run:
            files.move(path, to)
        self.moved[path] = to

    def take_record(self, path: Path) -> None:
        """Moves the files of a directory, its manifest first, except for its lock.

        Raises:
            WorkError: if the directory can't be read, or a file can't be moved.
        """
        folder = folder_at(path)
        if folder.problem is not None:
            raise WorkError(f"{path} {folder.problem}; it is left alone.")
        for name in sorted(folder.names, key=lambda name: (name != MANIFEST, name)):
            if name != locks.LOCK:
                self.take(path / name)


def repair(results: Results, findings: Sequence[Finding], dry_run: bool = False) -> Repaired:
    """Moves damaged records and files that no manifest lists to the quarantine directory.

    Records that are being written, that can't be read at present or that a newer jbench wrote are
    not changed. Each record is checked again before it is moved. A dry run moves nothing.
    """
    quarantine, left, commands = Quarantine(results, dry_run), [], []
    faults = [finding for finding in findings if finding.severity != "warning"]
    for kind, id in dict.fromkeys((fault.kind, fault.id) for fault in faults):
        foreign = [f for f in faults if (f.kind, f.id, f.severity) == (kind, id, "foreign")]
        left += [f"{finding} It is left alone." for finding in foreign]
        if not foreign:
            try:
                command = _command(results, kind, id)
                if _repair_folder(results, kind, id, quarantine) and command not in commands:
                    commands.append(command)
            except (WorkError, RequestError) as error:
                left.append(str(error))
    return Repaired(list(quarantine.moved.items()), left, list(filter(None, commands)))


def _command(results: Results, kind: Kind, id: str) -> str:
    """Returns the command that made a record, or "" if its manifest does not tell."""
    with contextlib.suppress(WorkError, RequestError):
        record = results.find(kind, id)
        if record and isinstance(record.manifest.provenance.get("command"), list):
            return shell_command(record.manifest.provenance)
    return ""


def _repair_folder(results: Results, kind: Kind, id: str, quarantine: Quarantine) -> bool:
    """Repairs one directory, unless another process is writing there.

    Returns:
        Whether there was a damaged record, which no longer exists.
    """
    path = results.path / f"{kind}s" / id
    with _locked(path, f"the {kind} {id}", quarantine.dry_run):
        findings = examine(results, kind, id)
        foreign = [finding for finding in findings if finding.severity == "foreign"]
        if foreign:
            raise WorkError(f"{foreign[0]} It is left alone.")
        damaged = any(finding.severity == "damaged" for finding in findings)
        if damaged:
            quarantine.take_record(path)
        # Problems that `take_record` has not moved, such as a directory with the name of a file.
        for finding in findings:
            if os.path.lexists(finding.path):
                quarantine.take(finding.path)
        return damaged


def _locked(path: Path, whose: str, dry_run: bool) -> contextlib.AbstractContextManager[None]:
    """Holds the lock of a directory if it has one; directories without one have no writer."""
    if dry_run and locks.is_held(path):
        raise locks.HeldError(whose)
    if dry_run or not os.path.lexists(path / locks.LOCK):
        return contextlib.nullcontext()
    return locks.hold(path, whose)
