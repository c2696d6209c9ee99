"""Readers of each format: a CSV file, one that W&B exported, a Monitor's, npz and TensorBoard's.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import shlex
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jbench.errors import RequestError, WorkWarning
from jbench.importing.event_file import read_event_file
from jbench.importing.imported_file import ImportedFile
from jbench.importing.named_columns import known_columns, single_steps
from jbench.importing.request import RETURN, STEPS, TAGS, ImportRequest
from jbench.importing.sb3_files import read_evaluations, read_monitor
from jbench.importing.tables import (
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
from jbench.wording import in_prose

_LISTED = 3  # names in a message


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
    known, notes = known_columns(table, file)
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

    if request.return_column is None:
        for note in notes:
            warnings.warn(note, WorkWarning, stacklevel=2)

    points = _points(table, columns, file)
    kind = request.returns_kind(columns["return"])
    if "seed" not in columns:
        points["seed"] = request.seed_in(str(file.path))

    labels = [known[role] for role in ("task", "method") if role in known]
    by_seed: Any = points.groupby("seed")
    for seed, rows in by_seed:
        _check_is_one_run(table.loc[rows.index, labels], seed, file)

    return [Series(file, seed, kind, rows, columns) for seed, rows in by_seed]


def _check_is_one_run(labels: pd.DataFrame, seed: int, file: ImportedFile) -> None:
    """Raises a RequestError if the rows of a seed have several tasks or methods, in any column."""
    for column in labels:
        names = [*filter(None, labels[column].str.strip().unique())]
        if len(names) > 1:
            if len(names) > _LISTED:
                names[_LISTED:] = ["others"]
            raise RequestError(
                f"{file.path}: seed {seed} has rows of {in_prose(names, 'and')} in the column "
                f"{column!r}, and an import is of one; keep its rows, or compare all of them by "
                f"jbench report --curves {shlex.quote(str(file.path))}."
            )


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


def _read_evaluations(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of all evaluations of an `EvalCallback` of stable-baselines3."""
    points = read_evaluations(file)
    return [Series(file, request.seed_in(str(file.path)), "evaluation", points)]


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
