"""Writing and checking files: the only module of jbench that writes results.

A file appears under its name whole or not at all: it is written under another name, forced to the
disk, and renamed; then the directory is forced to the disk too, so that the name survives a power
cut.
"""

import errno
import hashlib
import os
import tempfile
from pathlib import Path

from jbench.errors import RequestError, WorkError

_TEMPORARY = ".writing-"


def make_directory(path: Path) -> None:
    """Makes a directory and its parents.

    Raises:
        RequestError: if something else stands there, or nothing may be written there.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
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
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=_TEMPORARY, dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        _sync_directory(path.parent)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise WorkError(
                f"No room left to write {path.name} in {path.parent}; what was finished is kept: "
                "make room and type the command again."
            ) from None
        raise WorkError(f"{path} can't be written ({error.strerror}).") from None


def remove_unlisted(directory: Path, listed: set[str]) -> None:
    """Removes what an interrupted writer of a record left beside its committed files."""
    for path in directory.iterdir():
        ours = path.suffix in (".parquet", ".safetensors", ".json")
        ours = ours or path.name.startswith(_TEMPORARY)
        if ours and path.name not in listed and path.is_file():
            path.unlink(missing_ok=True)


def sha256(content: bytes) -> str:
    """Returns the SHA-256 of some bytes in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _sync_directory(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
