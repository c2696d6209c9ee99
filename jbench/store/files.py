"""Atomic writing and safe reading of files, and what can be wrong with those of a record.

A directory is synced after its files, so that their names survive a power cut.
"""

import contextlib
import errno
import hashlib
import io
import os
import re
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Literal

from jbench.errors import RequestError, WorkError

_TEMPORARY = ".writing-"

WRITTEN = re.compile(rf"{re.escape(_TEMPORARY)}.*|.*\.(parquet|safetensors|json)", re.DOTALL)
"""Names of the files that a writer of a record may have written, complete or not."""

PLAIN = sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
"""Flags to open an untrusted file, which may be a symlink or a pipe; some systems lack some."""

MODE = 0o666
"""Permissions of a new file; the system takes away those of the user's umask."""

_NO_SYNC = (errno.EINVAL, errno.ENOTSUP)
"""Errors of network file systems that can't sync a directory."""

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | PLAIN

Sort = Literal["damaged", "leftover", "foreign", "warning"]
"""A record is damaged; no manifest lists a file; a record can't be checked, because a newer jbench
wrote it or reading fails; or a record is intact, with a warning.
"""


class RecordError(WorkError):
    """A record, or a file of it, can't be used; the problem is a clause to follow the path."""

    sort: Sort = "damaged"

    def __init__(self, path: Path, problem: str, advice: str = "") -> None:
        """Says what is wrong, and may add what to do, as a clause."""
        super().__init__(f"{path} {problem}{advice and '; '}{advice}.")
        self.path = path
        self.problem = problem

    @property
    def reason(self) -> str:
        """Path and problem, without the advice."""
        return f"{self.path} {self.problem}"


class DamagedError(RecordError):
    """It is missing or damaged."""


class UnreadableError(RecordError):
    """It can't be read at present, or only by a newer jbench; it may be intact."""

    sort = "foreign"


class NoRoomError(WorkError):
    """The disk is full: nothing more can be written, whatever the record."""

    def __init__(self, name: str, directory: Path) -> None:
        """Says what can't be written, and what to do."""
        super().__init__(
            f"No room left to write {name} in {directory}; what was finished is kept: free some "
            "space and type the command again."
        )


class NotPlainError(OSError):
    """A path is a symlink, a directory, a pipe or a device; `strerror` says which."""


def is_full(error: OSError) -> bool:
    """Returns whether there is no room for a file: on the disk, in a quota or by a limit."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def is_missing(error: OSError) -> bool:
    """Returns whether there is no regular file; after any other error, it may be intact."""
    return isinstance(error, FileNotFoundError | NotADirectoryError | NotPlainError)


def make_directory(path: Path, option: str | None = None) -> None:
    """Creates a directory and its parents; users name it by the option, if there is one.

    Raises a RequestError if the path is a file or not writable, a WorkError if the disk fails.
    """
    instead = "name a directory that you may write to"
    if option is not None:
        instead += f" by {option}"

    try:
        new = [parent for parent in (path, *path.parents) if not parent.exists()]
        path.mkdir(parents=True, exist_ok=True)
        for directory in new:
            _sync_directory(directory.parent)
    except (FileExistsError, NotADirectoryError):
        raise RequestError(f"{path} is a file, or lies in one; name a directory.") from None
    except OSError as error:
        # /proc has no directories of ours, and a file system may be mounted read-only.
        is_closed = isinstance(error, PermissionError | FileNotFoundError)
        if is_closed or error.errno == errno.EROFS:
            raise RequestError(f"{path} can't be made ({error.strerror}); {instead}.") from None
        if is_full(error):
            raise NoRoomError(path.name, path.parent) from None
        raise WorkError(f"The directory {path} can't be made ({error.strerror}).") from None

    if not os.access(path, os.W_OK | os.X_OK):
        raise RequestError(f"{path} is not writable; {instead}.")


def real(path: Path) -> Path:
    """Returns a path without symlinks; of links that lead in a circle, as it is."""
    return Path(os.path.realpath(path))  # Path.resolve raises an error for a circle


def check_output(path: Path, option: str = "--out") -> None:
    """Raises a RequestError if a file can't be written or replaced, before work on its content."""
    make_directory(path.parent, option)
    if path.exists() and not path.is_file():
        problem = "a directory" if path.is_dir() else "not a plain file"
        raise RequestError(f"{option} {path} is {problem}; name a file.")


def write_atomic(path: Path, content: bytes) -> None:
    """Writes a file; raises a WorkError if the disk is full or fails, and then changes nothing."""
    temporary = None
    try:
        new = path.with_name(f"{_TEMPORARY}{secrets.token_hex(8)}")
        handle = os.open(new, _NEW, MODE)
        temporary = new
        try:
            with os.fdopen(handle, "wb", closefd=False) as file:
                file.write(content)
            os.fsync(handle)
        finally:
            close(handle)

        _replace(temporary, path)
        temporary = None
        _sync_directory(path.parent)
    except OSError as error:
        if is_full(error):
            raise NoRoomError(path.name, path.parent) from None
        raise WorkError(f"{path} can't be written ({error.strerror}).") from None
    finally:
        if temporary is not None:
            remove([temporary])


def link(names: Mapping[Path, Path]) -> None:
    """Gives files second names, in directories that are made, if the file system has such names.

    Symlinks, and what is no file, get none.
    """
    for path, name in names.items():
        make_directory(name.parent)
        if path.is_file() and not path.is_symlink():
            with contextlib.suppress(OSError):
                os.link(path, name)

    for directory in {name.parent for name in names.values()}:
        with contextlib.suppress(OSError):
            _sync_directory(directory)


def move(path: Path, to: Path) -> None:
    """Moves a file or a directory within a file system; raises a WorkError if `to` exists.

    If `to` is a second name of the file, it becomes the only one.
    """
    make_directory(to.parent)
    try:
        if not os.path.lexists(to):
            path.rename(to)
        elif os.path.samestat(path.lstat(), to.lstat()):
            path.unlink()
        else:
            raise WorkError(f"{path} can't be moved to {to}, which exists.")
    except OSError as error:
        raise WorkError(f"{path} can't be moved to {to} ({error.strerror}).") from None

    # The move succeeded even if syncing fails.
    with contextlib.suppress(OSError):
        _sync_directory(to.parent)
        _sync_directory(path.parent)


@contextlib.contextmanager
def open_plain(path: Path) -> Iterator[io.BufferedReader]:
    """Opens a file for reading; raises an OSError if it is not a regular file, see `is_missing`."""
    _check_plain(os.lstat(path).st_mode)
    handle = os.open(path, os.O_RDONLY | PLAIN)
    try:
        _check_plain(os.fstat(handle).st_mode)
        yield os.fdopen(handle, "rb", closefd=False)
    finally:
        close(handle)


def _check_plain(mode: int) -> None:
    """Raises a NotPlainError unless a mode is that of a plain file."""
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFLNK: "a link to another place", stat.S_IFDIR: "Is a directory"}
        raise NotPlainError(errno.EINVAL, kinds.get(stat.S_IFMT(mode), "not a plain file"))


def close(handle: int) -> None:
    """Closes a file that was read, synced or locked, ignoring errors."""
    with contextlib.suppress(OSError):
        os.close(handle)


def entries(directory: Path) -> list[os.DirEntry[str]]:
    """Returns the entries of a directory, sorted by name; raises an OSError if it can't."""
    while True:
        with contextlib.suppress(InterruptedError), os.scandir(directory) as iterator:
            return sorted(iterator, key=lambda entry: entry.name)


def remove(paths: Iterable[Path]) -> None:
    """Removes files, ignoring errors."""
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink()


def sha256(content: bytes) -> str:
    """Returns the hexadecimal SHA-256."""
    return hashlib.sha256(content).hexdigest()


def _replace(temporary: Path, path: Path) -> None:
    """Renames a file; on Windows, waits for readers of the file that it replaces."""
    deadline = time.monotonic() + 2  # seconds
    while True:
        try:
            return os.replace(temporary, path)
        except PermissionError:
            if os.name != "nt" or time.monotonic() > deadline:
                raise
            time.sleep(0.01)


def _sync_directory(path: Path) -> None:
    """Makes the names in a directory durable, where the system can."""
    # Windows can't open a directory; NTFS keeps a journal of names.
    if os.name == "nt":
        return
    try:
        handle = os.open(path, os.O_RDONLY)
    except PermissionError:  # who may write in a directory need not be allowed to list it
        return

    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        close(handle)
