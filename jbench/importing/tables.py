"""Files to import, and the rows of those that are CSV.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import csv
import hashlib
import io
from codecs import BOM_UTF8
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import parse_seed

MAX_STEPS = 1 << 53
"""Largest number of control steps; float64 counts no further."""


class ImportedFile(NamedTuple):
    """A file to import, read at once."""

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
        raise RequestError(f"{path} can't be read ({error.strerror}).") from None
    if not content.removeprefix(BOM_UTF8).strip():
        raise RequestError(f"{path} is empty; leave the file out.")
    return ImportedFile(path, content, hashlib.sha256(content).hexdigest())


def read_table(file: ImportedFile, skip: int = 0, *, ends_line: bool = True) -> pd.DataFrame:
    """Returns the rows of a CSV file as texts, indexed by their line, without lines to skip.

    ends_line: whether the last line of a whole file ends with a line break.
    """
    try:
        text = file.content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RequestError(f"{file.path} is not a CSV file: it is not text (UTF-8).") from None
    lines = list(io.StringIO(text, newline=""))
    last = f"{file.path}, line {len(lines)}: "
    # The separator that the header has most; spreadsheets of some languages write ;.
    separator = max(",;\t", key="".join(lines[skip : skip + 1]).count)
    reader = csv.reader(lines[skip:], delimiter=separator, strict=True)
    rows: dict[int, list[str]] = {}
    try:
        for fields in filter(None, reader):
            rows[skip + reader.line_num] = fields
    except csv.Error as error:
        is_cut = "end of data" in str(error)
        reason = f"{last}the file is cut off" if is_cut else f"{file.path}: {error}"
        raise RequestError(f"{reason}; it can't be read as CSV.") from None
    header = next(iter(rows.values()), [])
    for line, fields in rows.items():
        if len(fields) != len(header):
            is_cut = line == len(lines) and len(fields) < len(header)
            raise RequestError(
                f"{file.path}, line {line}: {len(fields)} fields, but the header has "
                f"{len(header)}{'; the file is cut off' if is_cut else ''}."
            )
    if ends_line and not text.endswith(("\n", "\r")):
        raise RequestError(
            f"{last}the line has no end, so the file is cut off; copy it again, or remove that "
            "line."
        )
    doubled = {name for name in header if header.count(name) > 1}
    if doubled:
        raise RequestError(f"{file.path} has two columns {min(doubled)!r}; rename one of them.")
    if len(rows) < 2:
        raise RequestError(f"{file.path} has a header, but no rows; leave the file out.")
    return pd.DataFrame(list(rows.values()), pd.Index(rows, name="line"), header).iloc[1:]


def check_column(
    table: pd.DataFrame, name: str, file: ImportedFile, instead: str = "it has"
) -> None:
    """Raises a RequestError if a table lacks a column; it ends with `instead` and the columns."""
    if name not in table:
        columns = ", ".join(map(str, table))
        raise RequestError(f"{file.path} has no column {name!r}; {instead} {columns}.")


def numbers(table: pd.DataFrame, columns: Mapping[str, str], file: ImportedFile) -> pd.DataFrame:
    """Returns columns of `read_table`, each by its new name, as finite numbers."""
    frame = pd.DataFrame(index=table.index)
    for name, column in columns.items():
        check_column(table, column, file)
        values = pd.to_numeric(table[column], errors="coerce").to_numpy(np.float64)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            line, text = table.index[bad[0]], table[column].iloc[bad[0]]
            raise RequestError(
                f"{file.path}, line {line}: {column} is {text[:40]!r}, which is not a finite "
                "number."
            )
        frame[name] = values
    return frame


def seeds(table: pd.DataFrame, name: str, file: ImportedFile) -> pd.Series:
    """Returns the seeds in a column of `read_table`; raises the error of `parse_seed`."""
    where = f"{file.path}, line"
    parsed = [parse_seed(text, f"{where} {line}: {name} is") for line, text in table[name].items()]
    return pd.Series(parsed, table.index)
