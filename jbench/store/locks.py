"""Write locks per record, released by the system when the process dies.

They are those of `portalocker`: advisory `flock` on Linux and macOS, locked bytes on Windows.
"""

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

import portalocker
from portalocker import LockFlags

from jbench.errors import ElsewhereError, WorkError
from jbench.store import files

LOCK = "lock"  # name of the lock file

_PATIENCE = 0.1  # s; who looks whether a lock is held has it for much less
_PAUSE = 0.002  # s between two tries


class HeldError(ElsewhereError):
    """Another process holds the lock of a record, such as `the run ID`."""

    def __init__(self, whose: str) -> None:
        """Says in a sentence whose lock is held."""
        super().__init__(f"Another process is writing {whose}; wait for it or stop it.")
        self.whose = whose

    @property
    def reason(self) -> str:
        """What another process does, without what to do."""
        return f"Another process is writing {self.whose}"


@contextlib.contextmanager
def hold(
    directory: Path,
    whose: str,
    kind: LockFlags = LockFlags.EXCLUSIVE | LockFlags.NON_BLOCKING,
    access: int = os.O_RDWR | os.O_CREAT,
    patience: float = _PATIENCE,
) -> Iterator[None]:
    """Holds a lock of a directory during the block; by default exclusive, hardly waiting.

    Raises a HeldError if another process holds it for `patience` s, a WorkError if the file can't
    be opened or locked.
    """
    path = directory / LOCK
    try:
        handle = os.open(path, access | files.PLAIN, files.MODE)
    except OSError as error:
        if files.is_full(error):
            raise files.NoRoomError(path.name, directory) from None
        raise WorkError(f"{path} can't be opened ({error.strerror}).") from None

    try:
        try:
            _lock(handle, kind, patience)
        except portalocker.AlreadyLocked:
            raise HeldError(whose) from None
        except portalocker.LockException as error:
            # portalocker wraps the error of the system.
            reason = getattr(error.__cause__, "strerror", None) or error
            raise WorkError(f"{path} can't be locked ({reason}).") from None

        yield
    finally:
        files.close(handle)


def _lock(handle: int, kind: LockFlags, patience: float) -> None:
    """Locks an open file; tries again for `patience` s if it is locked, and raises as portalocker.

    Who looks whether a lock is held (`is_held`) has it for a moment, and is no writer.
    """
    end = time.monotonic() + patience
    while True:
        try:
            portalocker.lock(handle, kind)
            return
        except portalocker.AlreadyLocked:
            if time.monotonic() >= end:
                raise
        time.sleep(_PAUSE)


def share(directory: Path) -> contextlib.AbstractContextManager[None]:
    """Holds a shared lock of a directory, which is made if necessary; raises as `hold`."""
    files.make_directory(directory)
    return hold(directory, str(directory), LockFlags.SHARED)


def is_held(directory: Path, shared: bool = False) -> bool:
    """Returns whether a process, on any machine, holds the lock of a directory; changes nothing.

    Locks that `share` holds count only if `shared`; some systems then require write access. Where
    files can't be locked, none is held.
    """
    access = os.O_RDONLY
    kind = LockFlags.SHARED
    if shared:
        access = os.O_RDWR
        kind = LockFlags.EXCLUSIVE

    try:
        with hold(directory, "", kind | LockFlags.NON_BLOCKING, access, patience=0):
            return False
    except WorkError as error:
        return isinstance(error, HeldError)
