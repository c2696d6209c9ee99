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
from jbench.store.record import Record
from jbench.store.verify import Flaw, examine


class Repaired(NamedTuple):
    """What was moved from where to where, why the rest was not, and commands to make it again."""

    moved: list[tuple[Path, Path]]
    left: list[str]
    commands: list[str]


class Quarantine:
    """A new quarantine directory, created on first use."""

    def __init__(self, results: Results, dry_run: bool = False) -> None:
        self.moved: dict[Path, Path] = {}
        self.dry_run = dry_run
        self._results = results
        root, now = results.inside("set-aside"), datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
        # The clock may have been set back.
        names = itertools.chain((now,), (f"{now}-{n}" for n in itertools.count(2)))
        self._path = next(root / name for name in names if not (root / name).exists())

    def take(self, path: Path) -> None:
        """Moves a file or directory, keeping its path relative to the results."""
        if path not in self.moved:
            to = self._path / path.relative_to(self._results.path)
            if not self.dry_run:
                files.move(path, to)
            self.moved[path] = to

    def take_record(self, record: Record) -> None:
        """Moves the files of a record of `Results.look`, its manifest first, but not its lock."""
        record.check()
        for name in sorted(record.names, key=lambda name: (name != MANIFEST, name)):
            if name != locks.LOCK:
                self.take(record.path / name)


def repair(results: Results, findings: Sequence[Flaw], dry_run: bool = False) -> Repaired:
    """Moves damaged records and files that no manifest lists to the quarantine directory.

    Records that are being written, that can't be read at present or that a newer jbench wrote are
    not changed. Each record is checked again before it is moved. A dry run moves nothing.
    """
    quarantine, left, commands = Quarantine(results, dry_run), [], []
    faults = [flaw for flaw in findings if flaw.sort != "warning"]
    for kind, id in dict.fromkeys((flaw.kind, flaw.id) for flaw in faults):
        try:
            commands += _repair_folder(results, kind, id, quarantine)
        except (WorkError, RequestError) as error:
            left.append(str(error))
    return Repaired(list(quarantine.moved.items()), left, list(dict.fromkeys(commands)))


def _repair_folder(results: Results, kind: Kind, id: str, quarantine: Quarantine) -> list[str]:
    """Repairs a folder unless it is locked; returns the command that makes its record again."""
    folder, dry_run, whose = results.look(kind, id), quarantine.dry_run, f"the {kind} {id}"
    folder.check()
    if dry_run and locks.is_held(folder.path):
        raise locks.HeldError(whose)
    # Folders without a lock have no writer.
    unlocked = dry_run or not os.path.lexists(folder.path / locks.LOCK)
    with contextlib.nullcontext() if unlocked else locks.hold(folder.path, whose):
        record, flaws = examine(results, kind, id)
        for flaw in flaws:
            if flaw.sort == "foreign":
                raise WorkError(f"{flaw} It is left alone.")
        is_damaged = any(flaw.sort == "damaged" for flaw in flaws)
        if is_damaged:
            quarantine.take_record(results.look(kind, id))
        # Problems that `take_record` has not moved, such as a directory with the name of a file.
        for flaw in flaws:
            if os.path.lexists(flaw.path):
                quarantine.take(flaw.path)
    made = {} if record is None or not is_damaged else record.manifest.provenance
    return [shell_command(made)] if isinstance(made.get("command"), list) else []
