"""A learning curve that was read, and the checks of its points."""

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
