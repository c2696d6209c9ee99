"""Files of stable-baselines3's `Monitor`: training episodes of one environment."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile, ImportRequest
from jbench.importing.series import Series, check_points, numbers
from jbench.importing.table import check_columns, read_table
from jbench.names import SUITE_TASKS, TASKS
from jbench.registration import environment_id

_MAX_TIME = 1e12  # s since 1970; excludes NaN and infinity


def read(file: ImportedFile, request: ImportRequest) -> list[Series]:
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
    for name in "rlt":
        check_columns(table, file, "--from", name)
    returns, lengths, times = (numbers(table, name, file) for name in "rlt")
    points = pd.DataFrame(
        {
            "episode_return": returns,
            "length": lengths,
            "control_steps": lengths.cumsum(),
            "wall_time": times + head["t_start"],
        }
    )
    check_points(points, file, lambda row: f"line {table.index[row]}")
    back = np.flatnonzero(np.diff(points["wall_time"]) < 0)
    if len(back):
        raise RequestError(
            f"{file.path}, line {table.index[back[0] + 1]}: the time t goes back, so a second "
            "training was appended; split the file."
        )
    return [Series(file, request.seed_in(str(file.path), "the path"), "training", points, {})]


def joined(parts: Sequence[Series]) -> pd.DataFrame:
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
