"""Write locks per record, released by the system when the process dies.

They are those of `portalocker`: advisory `flock` on Linux and macOS, locked bytes on Windows.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import portalocker
from portalocker import LockFlags

from jbench.errors import WorkError
from jbench.store import files

LOCK = "lock"
"""Name of the lock file."""


class HeldError(WorkError):
    """Another process holds the lock."""

    def __init__(self, whose: str) -> None:
        """Makes the error.

        Args:
            whose: the locked record, such as `the run ID`.
        """
        super().__init__(f"Another process is writing {whose}; wait for it or stop it.")


@contextlib.contextmanager
def hold(directory: Path, whose: str) -> Iterator[None]:
    """Holds the exclusive lock of a directory during the block.

    Args:
        whose: the locked record, for the error.

    Raises:
        HeldError: if another process holds the lock.
        WorkError: if the file can't be opened or locked.
    """
    path = directory / LOCK
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | files.PLAIN, 0o644)
    except OSError as error:
        raise WorkError(f"{path} can't be opened ({error.strerror}).") from None
    try:
        try:
            portalocker.lock(handle, LockFlags.EXCLUSIVE | LockFlags.NON_BLOCKING)
        except portalocker.AlreadyLocked:
            raise HeldError(whose) from None
        except portalocker.LockException as error:
            raise WorkError(f"{path} can't be locked ({_reason(error)}).") from None
        yield
    finally:
        files.close(handle)


def is_held(directory: Path) -> bool:
    """Returns whether a process holds the lock of a directory; changes nothing."""
    return _refuses(directory, os.O_RDONLY, LockFlags.SHARED)


@contextlib.contextmanager
def share(directory: Path) -> Iterator[None]:
    """Holds a shared lock of a directory, which is created if necessary, during the block.

    Raises:
        RequestError: if the directory can't be created.
        WorkError: if the file system has no locks.
    """
    files.make_directory(directory)
    path = directory / LOCK
    with contextlib.ExitStack() as opened:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | files.PLAIN, 0o644)
            opened.callback(files.close, handle)
            portalocker.lock(handle, LockFlags.SHARED)
        except (OSError, portalocker.LockException) as error:
            raise WorkError(f"{path} can't be locked ({_reason(error)}).") from None
        yield


def is_shared(directory: Path) -> bool:
    """Returns whether a process on any machine holds a shared lock of a directory."""
    return _refuses(directory, os.O_RDWR, LockFlags.EXCLUSIVE)


def _refuses(directory: Path, access: int, kind: LockFlags) -> bool:
    """Returns whether a lock of a directory can't be acquired.

    Args:
        access: mode in which to open the file; some file systems require write access.
        kind: exclusive or shared.
    """
    try:
        handle = os.open(directory / LOCK, access | files.PLAIN)
    except OSError:
        return False
    try:
        portalocker.lock(handle, kind | LockFlags.NON_BLOCKING)
    except portalocker.LockException:
        return True
    finally:
        files.close(handle)
    return False


def _reason(error: Exception) -> str:
    """Returns what the system reports: the error itself, or the one that portalocker wraps."""
    return str(getattr(error.__cause__ or error, "strerror", None) or error)
