"""A file to import, whose text is in UTF-8 whatever program has written it."""

import hashlib
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from jbench.errors import RequestError
from jbench.importing.foreign import refuse_foreign


class ImportedFile(NamedTuple):
    """A file to import, read at once.

    Attributes:
        path: of the file.
        content: its bytes; a text has no mark of its encoding, and is in UTF-8 if the mark says
            another one.
        sha256: checksum of its bytes as they are in the file.
    """

    path: Path
    content: bytes
    sha256: str


def open_file(path: Path) -> ImportedFile:
    """Returns a file with its content, which must not be empty."""
    try:
        content = path.read_bytes()
    except IsADirectoryError:
        raise RequestError(f"{path} is a directory; name the files in it.") from None
    except OSError as error:
        if "*" in str(path):  # a shell leaves a pattern as it is if no file matches
            raise RequestError(f"No file matches {path}; type where the files are.") from None
        raise RequestError(f"{path} can't be read ({error.strerror}).") from None

    sha256 = hashlib.sha256(content).hexdigest()
    content = _without_mark(content)
    refuse_foreign(path, content)
    if not content.strip():
        raise RequestError(f"{path} is empty; leave the file out.")

    return ImportedFile(path, content, sha256)


def _without_mark(content: bytes) -> bytes:
    """Returns the content of a file in UTF-8, without marks of an encoding at its beginning.

    Excel and PowerShell write UTF-16 with such a mark. A program that adds one to a file may find
    one there.
    """
    if content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        with suppress(UnicodeDecodeError):
            content = content.decode("utf-16").encode()

    while content.startswith(BOM_UTF8):
        content = content.removeprefix(BOM_UTF8)

    return content
