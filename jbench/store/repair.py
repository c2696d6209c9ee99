"""Repairing a results directory: damaged records and leftover files are moved to the quarantine.

All files of a damaged record are moved, its manifest first: the record then no longer exists, and
the command that made it makes it again. Its lock stays, since another process may hold it.
"""

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.store import locks
from jbench.store.database import Results
from jbench.store.folder import Folder
from jbench.store.manifest import RecordKind
from jbench.store.provenance import shell_command
from jbench.store.quarantine import Quarantine
from jbench.store.verify import Flaw, examine


class Repaired(NamedTuple):
    """What a repair has done.

    Attributes:
        moved: paths before and after, of what was moved to the quarantine.
        left: a sentence for each record that was not changed, though something is wrong with it.
        commands: those that make the moved records again.
    """

    moved: list[tuple[Path, Path]]
    left: list[str]
    commands: list[str]


def repair(results: Results, findings: Sequence[Flaw], dry_run: bool = False) -> Repaired:
    """Moves damaged records and files that no manifest lists to the quarantine directory.

    Records that are being written, that can't be read at present or that a newer jbench wrote are
    not changed. Each record is checked again before it is moved. A dry run moves nothing.
    """
    quarantine = Quarantine(results, dry_run)
    left = []
    commands = []
    faults = [flaw for flaw in findings if flaw.sort != "warning"]
    for kind, id in dict.fromkeys((flaw.kind, flaw.id) for flaw in faults):
        try:
            commands += _repair_folder(results, kind, id, quarantine)
        except (WorkError, RequestError) as error:
            left.append(str(error))

    return Repaired(list(quarantine.moved.items()), left, list(dict.fromkeys(commands)))


def _without_writer(folder: Folder, dry_run: bool) -> contextlib.AbstractContextManager[object]:
    """Returns a context in which no other process writes a folder; a HeldError if one does now."""
    noun = f"the {folder.kind} {folder.id}"
    if dry_run and locks.is_held(folder.path):
        raise locks.HeldError(noun)
    # Folders without a lock have no writer.
    if dry_run or not os.path.lexists(folder.path / locks.LOCK):
        return contextlib.nullcontext()

    return locks.hold(folder.path, noun)


def _repair_folder(
    results: Results, kind: RecordKind, id: str, quarantine: Quarantine
) -> list[str]:
    """Repairs a folder unless it is locked; returns the command that makes its record again."""
    folder = results.found(kind, id)
    folder.check()
    with _without_writer(folder, quarantine.dry_run):
        record, flaws = examine(results, kind, id)
        for flaw in flaws:
            if flaw.sort == "foreign":
                raise WorkError(f"{flaw} It is left alone.")
        is_damaged = any(flaw.sort == "damaged" for flaw in flaws)
        if is_damaged:
            quarantine.take_record(results.found(kind, id))
        # Problems that `take_record` has not moved, such as a directory with the name of a file.
        for flaw in flaws:
            if os.path.lexists(flaw.path):
                quarantine.take(flaw.path)

    if record is None or not is_damaged:
        return []

    made = record.manifest.provenance
    if not isinstance(made.get("command"), list):
        return []
    return [shell_command(made)]
