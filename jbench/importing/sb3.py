"""Files of stable-baselines3: `monitor.csv` and `evaluations.npz`."""

import io
import json
import zipfile
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.reader import Series, check_columns, check_points, numbers, read_table
from jbench.importing.request import ImportedFile, ImportRequest
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.task_specs import SUITE_TASKS

_MONITOR = {"episode_return": "r", "length": "l", "wall_time": "t"}
_MAX_TIME = 1e12  # s since 1970; excludes NaN and infinity
_ARRAYS = ("timesteps", "results", "ep_lengths")
_UNREADABLE = (
    *(ValueError, TypeError, AttributeError, OSError, EOFError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)


def read_monitor(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of one environment; their time is that of the clock, in s.

    Raises:
        RequestError: if it is not a whole file of a Monitor.
    """
    head = _head(file)
    for task in (*TASKS, *SUITE_TASKS):
        ids = environment_id(task), environment_id(task, augmented=True)
        if task != request.task and head.get("env_id") in ids:
            raise RequestError(
                f"{file.path} is of {head['env_id']}, which is --task {task}, not {request.task}."
            )
    table = read_table(file, skip=1)
    for name in _MONITOR.values():
        check_columns(table, file, {"--from": name})
    points = pd.DataFrame({name: numbers(table, short, file) for name, short in _MONITOR.items()})
    points["control_steps"] = points["length"].cumsum()
    points["wall_time"] += head["t_start"]
    check_points(points, file, lambda row: f"line {table.index[row]}")
    back = np.flatnonzero(np.diff(points["wall_time"]) < 0)
    if len(back):
        raise RequestError(
            f"{file.path}, line {table.index[back[0] + 1]}: the time t goes back, so a second "
            "training was appended; split the file."
        )
    return [Series(file, request.seed_in(str(file.path), "the path"), "training", points, {})]


def join_environments(parts: Sequence[Series]) -> pd.DataFrame:
    """Returns the episodes of all environments of a seed, in the order in which they ended."""
    points = pd.concat([part.points for part in parts], ignore_index=True)
    points = points.sort_values("wall_time", kind="stable", ignore_index=True)
    return points.assign(control_steps=points["length"].cumsum())


def _head(file: ImportedFile) -> dict[str, Any]:
    """Returns the JSON of the first line."""
    try:
        first, _, _ = file.content.partition(b"\n")
        parsed = json.loads(first.removeprefix(b"#")) if first[:1] == b"#" else None
    except ValueError:
        parsed = None
    head = parsed if isinstance(parsed, dict) else {}
    start = head.get("t_start")
    if not isinstance(start, int | float) or not abs(start) < _MAX_TIME:
        raise RequestError(
            f'{file.path}, line 1: not a file of a Monitor, which begins with {{"t_start": …}} '
            "after a #."
        )
    return head


def read_evaluations(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of all evaluations.

    Raises:
        RequestError: if it is not a whole file of an `EvalCallback`.
    """
    try:
        with np.load(io.BytesIO(file.content), allow_pickle=False) as arrays:
            steps, returns, lengths = (arrays[name].astype(np.float64) for name in _ARRAYS)
    except KeyError as error:
        raise RequestError(f"{file.path} is not of an EvalCallback: {error.args[0]}.") from None
    except _UNREADABLE as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise RequestError(
            f"{file.path} is cut off, or not an evaluations.npz ({reason})."
        ) from None
    if returns.ndim != 2 or steps.shape != returns.shape[:1] or lengths.shape != returns.shape:
        raise RequestError(
            f"{file.path} is not of an EvalCallback: its arrays have the shapes {steps.shape}, "
            f"{returns.shape} and {lengths.shape}."
        )
    count, episodes = returns.shape
    points = pd.DataFrame(
        {
            "point": np.repeat(np.arange(count), episodes),
            "control_steps": np.repeat(steps, episodes),
            "episode": np.tile(np.arange(episodes), count),
            "episode_return": returns.ravel(),
            "length": lengths.ravel(),
        }
    )
    check_points(points, file, lambda row: f"evaluation {row // episodes + 1}")
    return [Series(file, request.seed_in(str(file.path), "the path"), "evaluation", points, {})]
