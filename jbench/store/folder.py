"""A folder of a results directory, which is a record if it has a manifest."""

import contextlib
import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from jbench.store import files, locks
from jbench.store.manifest import MANIFEST, FileEntry, RecordKind


@dataclass(frozen=True)
class Folder:
    """A folder of a results directory, which is a record if it has a manifest.

    Attributes:
        names: of its files and symlinks, and the manifest's even if that is a folder; they are
            known of a folder that `Results.walk` has found.
        problem: a clause on why it can't be read; None if it can.
        may_lack: names of files that the manifest may list although the folder lacks them.
    """

    path: Path
    kind: RecordKind
    id: str
    names: Collection[str] = (MANIFEST,)
    problem: str | None = None
    may_lack: Collection[str] = ()

    def check(self) -> None:
        """Raises an `UnreadableError` if the folder can't be read."""
        if self.problem is not None:
            raise files.UnreadableError(self.path, self.problem)

    def has_left_out(self, entry: FileEntry) -> bool:
        """Returns whether a file was left out on purpose, such as a policy that the wheel lacks."""
        return entry.name in self.may_lack and not os.path.lexists(self.path / entry.name)

    def lock(self) -> contextlib.AbstractContextManager[None]:
        """Locks the folder during a block; see `locks.hold`."""
        files.make_directory(self.path)
        return locks.hold(self.path, f"the {self.kind} {self.id}")
