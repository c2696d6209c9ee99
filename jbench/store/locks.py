"""Who writes: a file in each record that its writer holds; a dead process holds nothing."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from jbench.errors import WorkError

LOCK = "lock"
"""Name of that file."""

# A stranger's may be a link to a file elsewhere, or a pipe that one would wait for.
_CAREFULLY = os.O_NOFOLLOW | os.O_NONBLOCK


@contextlib.contextmanager
def hold(directory: Path, whose: str) -> Iterator[None]:
    """Holds the lock of a directory while the block lasts.

    Args:
        directory: of the lock.
        whose: what is written, for the error.

    Raises:
        WorkError: if another process holds it, or it can't be opened.
    """
    path = directory / LOCK
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | _CAREFULLY, 0o644)
    except OSError as error:
        raise WorkError(f"{path} can't be opened ({error.strerror}).") from None
    with os.fdopen(handle):
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise WorkError(
                f"Another process is writing {whose}; wait for it or stop it."
            ) from None
        yield


def is_held(directory: Path) -> bool:
    """Returns whether some process holds the lock of a directory; changes nothing."""
    try:
        handle = os.open(directory / LOCK, os.O_RDONLY | _CAREFULLY)
    except OSError:
        return False
    with os.fdopen(handle):
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
