"""Readers of each format: a CSV file, one that W&B exported, a Monitor's, npz and TensorBoard's.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.importing.event_file import read_event_file
from jbench.importing.named_columns import known_columns, single_steps
from jbench.importing.request import RETURN, STEPS, TAGS, ImportRequest
from jbench.importing.tables import (
    ImportedFile,
    check_column,
    numbers,
    read_table,
    rows_with_value,
    seeds,
)
from jbench.importing.wandb_chart import NOT_CONTROL_STEPS, columns_of_runs
from jbench.names import TASKS, ImportFormat, ReturnsName
from jbench.registration import environment_id
from jbench.task_specs import SUITE_TASKS

_MAX_TIME = 1e12  # s since 1970; excludes NaN and infinity
_ARRAYS = ("timesteps", "results", "ep_lengths")


class Series(NamedTuple):
    """The learning curve of a seed, or a part of it, in one file; columns are those that were read.

    Points are control_steps and episode_return, and if known episode, length and wall_time; of
    several episodes in one evaluation with the column point. Messages call a row by the name of the
    index and its value, such as `line 3`.
    """

    file: ImportedFile
    seed: int
    returns: ReturnsName
    points: pd.DataFrame
    columns: Mapping[str, str] = {}
    resumed_at: float = np.inf  # control step from which it replaces earlier files of the seed


def _read_csv(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each seed of a file with a row per point."""
    table = read_table(file)
    known, _ = known_columns(table, file)
    columns = {
        "steps": request.steps_column or known.get("steps", STEPS[0]),
        "return": request.return_column or known.get("return", RETURN[0]),
    }
    if request.seed_from is None:
        columns["seed"] = request.seed_column or known.get("seed", "seed")

    for role, column in columns.items():
        option = f"--{role}-column"
        if role == "seed":
            option = f"--seed-from REGEX, or {option}"
        check_column(table, column, file, f"type {option} with one of")

    points = _points(table, columns, file)
    kind = request.returns_kind(columns["return"])
    if "seed" not in columns:
        return [Series(file, request.seed_in(str(file.path)), kind, points, columns)]

    by_seed: Any = points.groupby("seed")
    return [Series(file, seed, kind, rows, columns) for seed, rows in by_seed]


def _read_wandb(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each run of a chart that W&B exported; see `wandb_chart`."""
    # W&B ends the last line without a line break.
    table = read_table(file, ends_line=False)
    steps = request.steps_column or str(table.columns[0])
    check_column(table, steps, file, "type --steps-column with one of")
    if request.steps_column is None and steps in NOT_CONTROL_STEPS:
        raise RequestError(
            f"The horizontal axis of {file.path} is {steps!r}, which need not be control steps; "
            f"choose the axis global_step in W&B, or type --steps-column {steps!r} if it is."
        )

    runs = columns_of_runs(table)
    reason = "not exactly one metric"
    metric = request.return_column or ""
    if metric:
        reason = f"no metric {metric!r}"
    elif len(runs) == 1:
        (metric,) = runs

    if metric not in runs:
        raise RequestError(
            f"{file.path} has {reason}; type --return-column with one of "
            f"{', '.join(sorted(runs)) or '(none)'}; a chart has columns 'RUN - METRIC'."
        )

    kind = request.returns_kind(metric)
    series = []
    for run, column in runs[metric].items():
        columns = {"steps": steps, "return": column}
        seed = request.seed_in(run, f"{file.path}, the run")
        series.append(Series(file, seed, kind, _points(table, columns, file), columns))

    return series


def _points(table: pd.DataFrame, columns: Mapping[str, str], file: ImportedFile) -> pd.DataFrame:
    """Returns the points of rows with a return."""
    rows = rows_with_value(table, columns["return"])
    if rows.empty:
        raise RequestError(f"{file.path} has no value of {columns['return']}; leave it out.")
    names = {"control_steps": columns["steps"], "episode_return": columns["return"]}
    points = numbers(rows, names, file)
    points["control_steps"] = single_steps(points["control_steps"], columns["steps"])
    if "seed" in columns:
        points["seed"] = seeds(rows, columns["seed"], file)
    return points


def _read_monitor(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of one environment of stable-baselines3, at times of the clock in s."""
    monitor = read_monitor(file)
    for task in (*TASKS, *SUITE_TASKS):
        ids = environment_id(task), environment_id(task, augmented=True)
        if task != request.task and monitor.env_id in ids:
            raise RequestError(
                f"{file.path} is of {monitor.env_id}, which is --task {task}, not {request.task}."
            )

    if monitor.restarts:
        raise RequestError(
            f"{file.path}, line {monitor.restarts[0]}: the time t goes back, so a second training "
            "was appended; split the file."
        )

    return [Series(file, request.seed_in(str(file.path)), "training", monitor.points)]


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


def _read_evaluations(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of all evaluations of an `EvalCallback` of stable-baselines3."""
    points = read_evaluations(file)
    return [Series(file, request.seed_in(str(file.path)), "evaluation", points)]


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


def _read_events(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the values of one tag of TensorBoard; their time is that of the clock, in s."""
    events = read_event_file(file)
    tag = request.tag
    scalars = events.scalars
    if not scalars:
        raise RequestError(f"{file.path} has no scalars; leave the file out.")

    known = [*TAGS]
    reason = "not exactly one known tag of returns"
    if tag is not None:
        known = [tag]
        reason = f"no tag {tag!r}"

    tags = [name for name in known if name in scalars]
    if len(tags) != 1:
        raise RequestError(
            f"{file.path} has {reason}; type --tag with one of {', '.join(sorted(scalars))}."
        )

    names = ["control_steps", "wall_time", "episode_return"]
    points = pd.DataFrame(scalars[tags[0]], columns=names).rename_axis("value")
    points.index += 1
    series = Series(
        file=file,
        seed=request.seed_in(str(file.path)),
        returns=request.returns_kind(tags[0]),
        points=points,
        columns={"return": tags[0]},
        resumed_at=events.resumed_at,
    )
    return [series]


@dataclass(frozen=True)
class Format:
    """A format of files.

    Attributes:
        read: returns the learning curves of a file, or the parts of them that it has.
        ordered_by: column whose first value orders the files of a seed; None: it has only one.
        is_log: whether it is a log of training, in which several episodes may end at one step.
    """

    read: Callable[[ImportedFile, ImportRequest], list[Series]]
    ordered_by: str | None = None
    is_log: bool = False


FORMATS: dict[ImportFormat, Format] = {
    "sb3-monitor": Format(_read_monitor, ordered_by="wall_time", is_log=True),
    "sb3-evaluations": Format(_read_evaluations),
    "tensorboard": Format(_read_events, ordered_by="control_steps", is_log=True),
    "wandb-csv": Format(_read_wandb),
    "csv": Format(_read_csv),
}
