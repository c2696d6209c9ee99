"""Files of stable-baselines3: those of a Monitor, and the evaluations.npz of an EvalCallback."""

import io
import json
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.importing.imported_file import ImportedFile
from jbench.importing.tables import numbers, read_table

_MAX_TIME = 1e12  # s since 1970; excludes NaN and infinity
_ARRAYS = ("timesteps", "results", "ep_lengths")


class Monitor(NamedTuple):
    """The file of a Monitor of stable-baselines3, which has the episodes of one environment.

    Points are episode_return, length, wall_time (of the clock, in s) and control_steps.
    """

    env_id: str  # of Gymnasium; empty if unknown
    points: pd.DataFrame
    restarts: list[int]  # lines at which the time goes back, as after a training was resumed


def read_monitor(file: ImportedFile) -> Monitor:
    """Reads the file of a Monitor; a later restart counts on from the episode before it."""
    first, _, _ = file.content.partition(b"\n")
    try:
        head = json.loads(first.removeprefix(b"#"))
        start = head["t_start"]
    except (ValueError, TypeError, KeyError):
        start = None

    is_head = first.startswith(b"#") and isinstance(start, int | float)
    if not is_head or not abs(start) < _MAX_TIME:
        raise RequestError(
            f'{file.path}, line 1: not a file of a Monitor, which begins with {{"t_start": …}} '
            "after a #."
        )

    appended = file.content.find(b"\n#")
    if appended >= 0:
        line = file.content[:appended].count(b"\n") + 2
        raise RequestError(
            f"{file.path}, line {line}: the file of a second Monitor was appended; split the file "
            "there."
        )

    columns = {"episode_return": "r", "length": "l", "wall_time": "t"}
    points = numbers(read_table(file, skip=1), columns, file)
    back = points["wall_time"].diff() < 0
    lost = points["wall_time"].shift().where(back, 0.0).cumsum()
    points["wall_time"] += start + lost
    points["control_steps"] = points["length"].cumsum()
    return Monitor(str(head.get("env_id") or ""), points, [*points.index[back]])


def read_evaluations(file: ImportedFile) -> pd.DataFrame:
    """Returns point, control_steps, episode, episode_return and length of an evaluations.npz."""
    try:
        with np.load(io.BytesIO(file.content), allow_pickle=False) as saved:
            arrays = {n: saved[n].astype(np.float64) for n in _ARRAYS if n in saved}
    except Exception as error:  # a damaged file may raise almost any
        reason = "it is no archive of arrays"
        if file.content.startswith(b"PK"):
            reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise RequestError(
            f"{file.path} is cut off, or not an evaluations.npz ({reason})."
        ) from None

    missing = [name for name in _ARRAYS if name not in arrays]
    if missing:
        raise RequestError(f"{file.path} is not of an EvalCallback: no {', '.join(missing)}.")

    steps, returns, lengths = map(_numbers_of_episodes, arrays.values())
    shapes = [array.shape for array in (steps, returns, lengths)]
    dimensions = [len(shape) for shape in shapes]
    if dimensions != [1, 2, 2] or shapes[0] != shapes[1][:1] or shapes[1] != shapes[2]:
        raise RequestError(
            f"{file.path} is not of an EvalCallback: its arrays have the shapes "
            f"{', '.join(map(str, shapes))}."
        )

    point, episode = (index.ravel() for index in np.indices(returns.shape))
    values = {"episode_return": returns.ravel(), "length": lengths.ravel()}
    columns = {"point": point, "control_steps": steps[point], "episode": episode, **values}
    return pd.DataFrame(columns, pd.Index(point + 1, name="evaluation"))


def _numbers_of_episodes(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns an array without its last axis if that has one number, as returns of some have."""
    if array.ndim == 3 and array.shape[-1] == 1:
        return array[..., 0]
    return array
