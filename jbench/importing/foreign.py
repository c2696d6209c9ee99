"""Files that jbench doesn't read, known by their first bytes: what they are, what to type instead.

So are files of another format than the one that the user has typed.

No such file is opened further. A pickle runs code when it is loaded.
"""

import io
import re
import shlex
import zipfile
from pathlib import Path

from jbench.errors import RequestError
from jbench.names import ImportFormat

_UNPACKED_BY = {
    b"\x1f\x8b": "gunzip",
    b"BZh": "bunzip2",
    b"\xfd7zXZ\x00": "unxz",
    b"\x28\xb5\x2f\xfd": "unzstd",
}
"""First bytes of compressed files, and the command that unpacks them."""

_INSTEAD = {
    b"\xd0\xcf\x11\xe0": "a workbook of Excel; save its sheet as CSV",
    b"PAR1": "a Parquet file; write it as CSV, such as by to_csv of pandas",
    b"\x89HDF": "an HDF5 file; write its curves as CSV",
    b"MATLAB 5": "a file of MATLAB; write its curves as CSV, such as by writetable",
    b"MATLAB 7": "a file of MATLAB; write its curves as CSV, such as by writetable",
    b"\x93NUMPY": "an array of NumPy without names; write its curves as CSV",
    b"SQLite format": "a database of SQLite; write its curves as CSV",
    b"%PDF": "a PDF; name a file with the numbers",
    b"\x89PNG": "a picture; name a file with the numbers",
    b"<": "a web page; download the file itself, such as by the link Raw",
    b"version https://git-lfs": "a pointer of Git LFS; type: git lfs pull",
}
"""First bytes of files of other forms, what they are, and what to type instead."""

_PICKLES = tuple(b"\x80" + bytes([protocol]) for protocol in range(2, 6))

_EVENTS = b"brain.Event:"
"""In the first record of a file of TensorBoard."""

_MONITOR = re.compile(rb"\s*#[^\n]*\"t_start\"")
"""Beginning of the file of a Monitor; in other files, lines with a # are comments."""

_JSON = re.compile(rb"\s*[\[{]\s*[\[{\"]")
"""Beginning of a list or an object in JSON, which is not empty."""


def refuse_foreign(path: Path, content: bytes) -> None:
    """Raises a RequestError for a file of a form that jbench doesn't read."""
    quoted = shlex.quote(str(path))
    for start, command in _UNPACKED_BY.items():
        if content.startswith(start):
            raise RequestError(
                f"{path} is compressed; type: {command} {quoted}, and name the unpacked file."
            )

    if content.startswith(_PICKLES):
        raise RequestError(
            f"{path} is a pickle, which jbench does not open, since it may run code; write its "
            "curves as CSV."
        )

    beginning = content[:512].lstrip()
    for start, instead in _INSTEAD.items():
        if beginning.startswith(start):
            raise RequestError(f"{path} is {instead}.")

    names = _names_in_zip(content)
    if any(name.startswith("xl/") for name in names):
        raise RequestError(f"{path} is a workbook of Excel; save its sheet as CSV.")
    if any(not name.endswith(".npy") for name in names):
        raise RequestError(
            f"{path} is a zip archive; type: unzip {quoted}, and name the file with the curves."
        )


def refuse_other_format(path: Path, content: bytes, format: ImportFormat) -> None:
    """Raises a RequestError for a file whose first bytes are those of another format."""
    if _JSON.match(content):
        raise RequestError(
            f"{path} is JSON, which jbench import does not read; type: jbench report --curves "
            f"{shlex.quote(str(path))}, or write its curves as CSV."
        )

    found: ImportFormat | None = None
    if is_of_tensorboard(content):
        found = "tensorboard"
    elif is_of_monitor(content):
        found = "sb3-monitor"
    elif content.startswith(b"PK"):  # other archives than of arrays are refused before
        found = "sb3-evaluations"

    if found not in (None, format):
        raise RequestError(f"{path} is not of the format {format}; type --from {found}.")


def is_of_monitor(content: bytes) -> bool:
    """Returns whether a file begins as that of a Monitor of stable-baselines3 does."""
    return _MONITOR.match(content) is not None


def is_of_tensorboard(content: bytes) -> bool:
    """Returns whether a file begins as those of TensorBoard do."""
    return _EVENTS in content[:64]


def _names_in_zip(content: bytes) -> list[str]:
    """Returns the names in a zip archive; none if it is no such archive, or is damaged."""
    if not content.startswith(b"PK"):
        return []

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return archive.namelist()
    except Exception:  # a damaged file may raise almost any
        return []
