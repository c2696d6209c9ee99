"""CSV files as data frames of texts, and the checks of a learning curve's points."""

import io
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile
from jbench.names import EPISODE_STEPS, ReturnsName

_ROUNDING = 0.01  # of rewards that were summed in single precision
MAX_STEPS = 1 << 53
"""Largest number of control steps; float64 counts no further."""

_MAX = {"control_steps": MAX_STEPS, "length": (1 << 31) - 1}  # the column of lengths is int32


class Series(NamedTuple):
    """The learning curve of a seed, or a part of it, in one file.

    Attributes:
        returns: kind of return.
        points: control_steps and episode_return, and if known episode, length and wall_time, a row
            per point; of several episodes in one evaluation with the column point.
        columns: columns or tags that were read.
    """

    file: ImportedFile
    seed: int
    returns: ReturnsName
    points: pd.DataFrame
    columns: Mapping[str, str]


def read_table(file: ImportedFile, skip: int = 0, *, ends_line: bool = True) -> pd.DataFrame:
    """Returns the rows of a CSV file as texts, indexed by their line.

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
    last = text.count("\n") + (not text.endswith("\n"))
    first = "".join(text.split("\n")[skip : skip + 1])
    try:
        lines = pd.read_csv(
            io.StringIO(text),
            # The separator that the header has most; spreadsheets of some languages write ;.
            sep=max(",;\t", key=first.count),
            skiprows=skip,
            header=None,
            dtype=object,
            keep_default_na=False,
            skip_blank_lines=False,
            engine="python",  # the other one fills short rows with empty texts
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        is_cut = "end of data" in str(error)
        reason = f", line {last}: the file is cut off" if is_cut else f": {error}"
        raise RequestError(f"{file.path}{reason}; it can't be read as CSV.") from None
    lines.index += skip + 1
    table = lines.dropna(how="all").iloc[1:]
    header = lines.iloc[0].tolist()
    for line, row in table[table.isna().any(axis=1)].iterrows():
        cut = "; the file is cut off" if line == last else ""
        raise RequestError(
            f"{file.path}, line {line}: {row.count()} fields, but the header has {len(header)}"
            f"{cut}."
        )
    if ends_line and not text.endswith(("\n", "\r")):
        raise RequestError(
            f"{file.path}, line {last}: the line has no end, so the file is cut off; copy it "
            "again, or remove that line."
        )
    doubled = {name for name in header if header.count(name) > 1}
    if doubled:
        raise RequestError(f"{file.path} has two columns {min(doubled)!r}; rename one of them.")
    if table.empty:
        raise RequestError(f"{file.path} has a header, but no rows; leave the file out.")
    return table.set_axis(header, axis=1)


def check_columns(table: pd.DataFrame, file: ImportedFile, columns: Mapping[str, str]) -> None:
    """Checks that there are the columns that options name.

    Args:
        columns: by option.

    Raises:
        RequestError: if one is missing.
    """
    for option, name in columns.items():
        if name not in table:
            raise RequestError(
                f"{file.path} has no column {name!r}; type {option} with one of "
                f"{', '.join(map(str, table))}."
            )


def numbers(table: pd.DataFrame, name: str, file: ImportedFile) -> NDArray[np.float64]:
    """Returns a column of `read_table` as finite numbers.

    Raises:
        RequestError: if one is not a finite number.
    """
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        line, text = table.index[bad[0]], table[name].iloc[bad[0]]
        raise RequestError(
            f"{file.path}, line {line}: {name} is {text[:40]!r}, which is not a finite number."
        )
    return values


def check_points(points: pd.DataFrame, file: ImportedFile, where: Callable[[int], str]) -> None:
    """Checks the returns, control steps and lengths of a learning curve.

    Args:
        points: see `Series.points`.
        where: returns what messages call a point, by its position.

    Raises:
        RequestError: if there is no point, or a value can't be one of a task.
    """
    if points.empty:
        raise RequestError(f"{file.path} has no episode; leave the file out.")
    returns = points["episode_return"].to_numpy(np.float64)
    bad = np.flatnonzero(~((returns >= -_ROUNDING) & (returns <= EPISODE_STEPS + _ROUNDING)))
    if len(bad):
        raise RequestError(
            f"{file.path}, {where(bad[0])}: the return is {returns[bad[0]]:g}, but that of an "
            f"episode is from 0 to {EPISODE_STEPS}; import returns of the task's own rewards, not "
            "scaled ones or those of another environment."
        )
    for name in (name for name in _MAX if name in points):
        counts = points[name].to_numpy(np.float64)
        bad = np.flatnonzero((counts < 0) | (counts % 1 != 0) | (counts > _MAX[name]))
        if len(bad):
            raise RequestError(
                f"{file.path}, {where(bad[0])}: {counts[bad[0]]:g} is no number of control steps."
            )
    steps = points["control_steps"].to_numpy(np.float64)
    back = np.flatnonzero(np.diff(steps) < 0)
    if len(back):
        after = back[0] + 1
        raise RequestError(
            f"{file.path}, {where(after)}: the control steps go back from {steps[back[0]]:,.0f} to "
            f"{steps[after]:,.0f}, so there is more than one training in the file; split it."
        )
