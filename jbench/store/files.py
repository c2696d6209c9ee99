"""Writing and checking files: the only module of jbench that writes results.

A file appears under its name whole or not at all: it is written under another name, forced to the
disk, and renamed; then the directory is forced to the disk too, so that the name survives a power
cut.
"""

import contextlib
import errno
import hashlib
import io
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from jbench.errors import RequestError, WorkError

_TEMPORARY = ".writing-"
_PIECE = 1 << 20  # bytes read at a time, where a file may be larger than memory


def make_directory(path: Path) -> None:
    """Makes a directory and its parents.

    Raises:
        RequestError: if something else stands there, or nothing may be written there.
    """
    new = [parent for parent in (path, *path.parents) if not parent.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        for made in new:
            _sync_directory(made.parent)
    except (FileExistsError, NotADirectoryError):
        raise RequestError(f"{path} is a file, or lies in one; name a directory.") from None
    except OSError as error:
        raise RequestError(
            f"{path} can't be made ({error.strerror}); name a directory that you may write to."
        ) from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise RequestError(f"{path} is not writable; name a directory that you may write to.")


def write_atomic(path: Path, content: bytes) -> None:
    """Writes a file that is there whole or not at all, whatever happens meanwhile.

    Raises:
        WorkError: if the disk is full or refuses; what was there before is still there.
    """
    with _replacing(path) as file:
        file.write(content)


def copy_atomic(source: Path, path: Path, wanted: str) -> None:
    """Copies a file in pieces; the copy is there whole, and with the wanted SHA-256, or not at all.

    Raises:
        WorkError: if the source can't be read or is another; or as `write_atomic`.
    """
    digest = hashlib.sha256()
    with _replacing(path) as file:
        for piece in _pieces(source):
            digest.update(piece)
            file.write(piece)
        if digest.hexdigest() != wanted:
            raise WorkError(f"{source} is damaged (its checksum differs); it is not copied.")


def move(path: Path, to: Path) -> None:
    """Moves a file or a directory within a file system; what stands there is never replaced.

    Raises:
        WorkError: if something stands there, or the disk refuses.
    """
    make_directory(to.parent)
    try:
        if os.path.lexists(to):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
        path.rename(to)
        _sync_directory(to.parent)
        _sync_directory(path.parent)
    except OSError as error:
        raise WorkError(f"{path} can't be moved to {to} ({error.strerror}).") from None


@contextlib.contextmanager
def _replacing(path: Path) -> Iterator[BinaryIO]:
    """Gives a file to write, which takes the place of another at the end of the block."""
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=_TEMPORARY, dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        temporary = None
        _sync_directory(path.parent)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise WorkError(
                f"No room left to write {path.name} in {path.parent}; what was finished is kept: "
                "make room and type the command again."
            ) from None
        raise WorkError(f"{path} can't be written ({error.strerror}).") from None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def open_plain(path: Path) -> io.BufferedReader:
    """Opens a file to read it, if it is one: no link, no directory, nothing that one waits for.

    Raises:
        OSError: if it is something else or can't be opened; its `strerror` says why.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "a link to another place") from None
        raise
    mode = os.fstat(handle).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(handle, "rb")
    os.close(handle)
    code = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
    raise OSError(code, os.strerror(code) if stat.S_ISDIR(mode) else "not a plain file")


def _pieces(path: Path) -> Iterator[bytes]:
    try:
        with open_plain(path) as file:
            while piece := file.read(_PIECE):
                yield piece
    except OSError as error:
        raise WorkError(f"{path} can't be read ({error.strerror}).") from None


def remove_unlisted(directory: Path, listed: set[str]) -> None:
    """Removes what an interrupted writer of a record left beside its committed files."""
    for path in directory.iterdir():
        ours = path.suffix in (".parquet", ".safetensors", ".json")
        ours = ours or path.name.startswith(_TEMPORARY)
        if ours and path.name not in listed and path.is_file():
            remove([path])


def remove(paths: Iterable[Path]) -> None:
    """Removes files that no manifest lists any more; one that is gone or stays is no error."""
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink()


def sha256(content: bytes) -> str:
    """Returns the SHA-256 of some bytes in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _sync_directory(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
