"""The rows of CSV files.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.imported_file import ImportedFile
from jbench.importing.path_names import PathNames
from jbench.importing.request import parse_seed
from jbench.importing.written_numbers import (
    correction_of,
    has_decimal_commas,
    may_have_thousands,
)

MAX_STEPS = 1 << 53
"""Largest number of control steps; float64 counts no further."""

_SEPARATOR = re.compile(r"sep=(.)\s*", re.IGNORECASE)
"""First line of a file that Excel has written, or that is meant for it."""

_SEPARATORS = ",;\t|"

_COMMENT = ("#", "%")
"""First characters of lines above the header that are comments."""


class CurveFile(NamedTuple):
    """The points of a file, and what a reader has to know of how it was read.

    Attributes:
        points: task, method, seed, steps and return, in this order.
        notes: sentences.
        named: labels of paths that the files of the points lack.
    """

    points: pd.DataFrame
    notes: list[str]
    named: Sequence[PathNames] = ()


def read_table(file: ImportedFile, skip: int = 0, *, ends_line: bool = True) -> pd.DataFrame:
    """Returns the rows of a CSV file as texts, indexed by their line, without lines to skip.

    Columns without a name and a value are left out, as are rows without a value: spreadsheets write
    both. Comments above the header are left out as well.

    ends_line: whether the last line of a whole file ends with a line break.
    """
    text = _text(file)
    lines = list(io.StringIO(text, newline=""))
    separator = ""
    if not skip:
        separator, skip = _head(lines)

    with _fields_of_any_length(text):
        separator = separator or _separator(lines[skip:])
        rows = _rows(file, lines, skip, separator)

    header = [name.strip() for name in next(iter(rows.values()), [])]
    for line, fields in rows.items():
        while len(fields) > len(header) and not fields[-1].strip():
            fields.pop()
        if len(fields) != len(header):
            is_last = line == len(lines)
            instead = _correction_of_row(len(fields), len(header), separator, is_last=is_last)
            raise RequestError(
                f"{file.path}, line {line}: {len(fields)} fields, but the header has "
                f"{len(header)}; {instead}."
            )

    if ends_line and not text.endswith(("\n", "\r")):
        raise RequestError(
            f"{file.path}, line {len(lines)}: the line has no end, so the file is cut off; copy it "
            "again, or remove that line."
        )

    if len(rows) < 2:
        raise RequestError(f"{file.path} has a header, but no rows; leave the file out.")

    table = pd.DataFrame(list(rows.values())[1:], pd.Index([*rows][1:], name="line"))
    kept = [i for i, name in enumerate(header) if name or len(rows_with_value(table, i))]
    names = [header[i] for i in kept]
    doubled = {name for name in names if names.count(name) > 1}
    if doubled == {""}:
        raise RequestError(
            f"{file.path} has several columns without a name; name them, or "
            "remove the lines above the header."
        )
    if doubled:
        raise RequestError(f"{file.path} has two columns {min(doubled)!r}; rename one of them.")

    return table[kept].set_axis(names, axis=1)


def _text(file: ImportedFile) -> str:
    """Returns the text of a file in UTF-8."""
    try:
        text = file.content.decode()
    except UnicodeDecodeError:
        text = "\0"

    if "\0" in text:
        raise RequestError(
            f"{file.path} is not a CSV file: it is not text (UTF-8). If it is text in another "
            "encoding, type: iconv -f ENCODING -t UTF-8 FILE > NEW"
        )

    return text


def _head(lines: list[str]) -> tuple[str, int]:
    """Returns the separator that a file names, or "", and the number of lines above its header."""
    named = _SEPARATOR.fullmatch(lines[0])
    if named is not None:
        return named[1], 1
    return "", _skip_comments(lines)


def _skip_comments(lines: list[str]) -> int:
    """Returns the number of comments and empty lines above the header.

    The header itself may be a comment, as numpy.savetxt writes it: it has as many separators as the
    line below it, which has numbers. It then loses its first character.
    """
    skip = 0
    header = None
    for line in lines:
        if not line.strip():
            skip += 1
            continue
        if not line.startswith(_COMMENT):
            break
        header = skip
        skip += 1

    if header is None or skip == len(lines):
        return skip

    below = lines[skip]
    for separator in _SEPARATORS:
        fields = below.split(separator)
        has_number = any(re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?", f.strip()) for f in fields)
        if has_number and len(fields) == len(lines[header].split(separator)) > 1:
            lines[header] = lines[header][1:]
            return header

    return skip


def _correction_of_row(fields: int, header: int, separator: str, *, is_last: bool) -> str:
    """Returns what to do about a row with another number of fields than the header."""
    if header == 1:
        return "remove the lines above the header, and separate columns by commas"
    if fields > header:
        return f"put a field that contains {separator!r} in quotes"
    if is_last:
        return "the file is cut off: copy it again, or remove that line"
    return "correct it, or remove that line"


def _separator(lines: list[str]) -> str:
    """Returns the separator with which header and first row have equally many, and most, fields.

    Names may contain other separators, quoted or not.
    """
    known: dict[str, tuple[bool, int]] = {}
    for separator in _SEPARATORS:
        records = filter(None, csv.reader(lines, delimiter=separator, strict=True))
        try:
            header = next(records, [])
        except csv.Error:
            continue

        try:
            row = next(records, header)
        except csv.Error:  # a damaged row says nothing
            row = header

        known[separator] = len(header) == len(row) > 1, len(header)

    return max(known, key=known.__getitem__, default=",")


def _rows(file: ImportedFile, lines: list[str], skip: int, separator: str) -> dict[int, list[str]]:
    """Returns the fields of each row by the number of its last line."""
    reader = csv.reader(lines[skip:], delimiter=separator, strict=True)
    rows: dict[int, list[str]] = {}
    try:
        for fields in reader:
            if any(field.strip() for field in fields):
                rows[skip + reader.line_num] = fields
    except csv.Error as error:
        problem = f"{file.path}: {error}"
        if "end of data" in str(error):
            problem = f"{file.path}, line {len(lines)}: the file is cut off"
        raise RequestError(f"{problem}; it can't be read as CSV.") from None

    return rows


@contextmanager
def _fields_of_any_length(text: str) -> Iterator[None]:
    """Lets Python's reader take fields as long as a text; RLlib's exceed its limit."""
    before = csv.field_size_limit(max(csv.field_size_limit(), len(text) + 1))
    try:
        yield
    finally:
        csv.field_size_limit(before)


def rows_with_value(table: pd.DataFrame, column: str | int) -> pd.DataFrame:
    """Returns the rows with a value in a column, which logs of several quantities may lack."""
    return table[table[column].str.strip() != ""]


def check_column(
    table: pd.DataFrame, name: str, file: ImportedFile, instead: str = "it has"
) -> None:
    """Raises a RequestError if a table lacks a column; it ends with `instead` and the columns."""
    if name not in table:
        columns = ", ".join(map(str, table))
        raise RequestError(f"{file.path} has no column {name!r}; {instead} {columns}.")


def numbers(table: pd.DataFrame, columns: Mapping[str, str], file: ImportedFile) -> pd.DataFrame:
    """Returns columns of `read_table`, each by its new name, as finite numbers.

    Raises a RequestError for a text that is none, and beside a column with decimal commas for one
    such as 1.000, whose point may stand between thousands.
    """
    for column in columns.values():
        check_column(table, column, file)

    texts = {column: table[column].str.strip() for column in columns.values()}
    with_commas = [column for column, each in texts.items() if has_decimal_commas(each.tolist())]
    frame = pd.DataFrame(index=table.index)
    for name, column in columns.items():
        problem = "is not a finite number"
        written = texts[column]
        if column in with_commas:
            written = written.str.replace(",", ".")

        values = pd.to_numeric(written, errors="coerce").to_numpy(np.float64)
        is_bad = ~np.isfinite(values)
        if with_commas and column not in with_commas and not is_bad.any():
            problem = f"may be in thousands, since {with_commas[0]} has decimal commas"
            is_bad = written.map(may_have_thousands).to_numpy(bool)

        if is_bad.any():
            line = table.index[is_bad][0]
            text = table.loc[line, column]
            raise RequestError(
                f"{file.path}, line {line}: {column} is {text[:40]!r}, which {problem}; "
                f"{correction_of(text)}."
            )

        frame[name] = values

    return frame


def seeds(table: pd.DataFrame, name: str, file: ImportedFile) -> pd.Series:
    """Returns the seeds in a column of `read_table`; raises the error of `parse_seed`."""
    where = f"{file.path}, line"
    parsed = [parse_seed(text, f"{where} {line}: {name} is") for line, text in table[name].items()]
    return pd.Series(parsed, table.index)
