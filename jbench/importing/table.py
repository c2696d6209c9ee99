"""CSV files as data frames of texts, with the line of each row."""

import csv
import io
import itertools

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile


def read_table(file: ImportedFile, skip: int = 0, *, ends_line: bool = True) -> pd.DataFrame:
    """Returns the rows of a CSV file as texts, indexed by their line.

    pandas itself fills rows that are cut off, so the rows are split by the csv module.

    Args:
        skip: lines before the header.
        ends_line: whether the last line of a whole file ends with a line break.

    Raises:
        RequestError: if it has no rows, is cut off, or not a CSV file.
    """
    try:
        text = file.content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RequestError(f"{file.path} is not a CSV file: it is not text (UTF-8).") from None
    header, rows = _split(text, file, skip)
    if ends_line and not text.endswith(("\n", "\r")):
        raise RequestError(
            f"{file.path}, line {max(rows, default=skip + 1)}: the line has no end, so the file is "
            "cut off; copy it again, or remove that line."
        )
    doubled = {name for name in header if header.count(name) > 1}
    if doubled:
        raise RequestError(f"{file.path} has two columns {min(doubled)!r}; rename one of them.")
    if not rows:
        raise RequestError(f"{file.path} has a header, but no rows; leave the file out.")
    return pd.DataFrame(list(rows.values()), list(rows), header, dtype=object)


def _split(text: str, file: ImportedFile, skip: int) -> tuple[list[str], dict[int, list[str]]]:
    """Returns the header of a CSV file, and its rows by the line where they end."""
    lines = io.StringIO(text, newline="")
    for _ in range(skip):
        next(lines)
    first = next(lines, "")
    # The separator that the header has most; spreadsheets of some languages write semicolons.
    separator = max(",;\t", key=first.count)
    reader = csv.reader(itertools.chain([first], lines), delimiter=separator, strict=True)
    rows: dict[int, list[str]] = {}
    try:
        header = next(reader, [])
        for row in filter(None, reader):
            line = skip + reader.line_num
            if len(row) != len(header):
                end = line == text.count("\n") + (not text.endswith("\n"))
                cut = "; the file is cut off" if end and len(row) < len(header) else ""
                raise RequestError(
                    f"{file.path}, line {line}: {len(row)} fields, but the header has "
                    f"{len(header)}{cut}."
                )
            rows[line] = row
    except csv.Error as error:
        cut = "the file is cut off" if "end of data" in str(error) else str(error)
        raise RequestError(
            f"{file.path}, line {skip + reader.line_num}: {cut}; it can't be read as CSV."
        ) from None
    return header, rows


def check_columns(table: pd.DataFrame, file: ImportedFile, option: str, name: str) -> None:
    """Checks that there is the column that an option names.

    Raises:
        RequestError: if there is none.
    """
    if name not in table:
        raise RequestError(
            f"{file.path} has no column {name!r}; type {option} with one of "
            f"{', '.join(map(str, table))}."
        )
