"""CSV files: with columns of any name, those that W&B exports, and those of a Monitor.

A `RequestError` says what is wrong with a file that is cut off or not of its format.
"""

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile, ImportRequest, Series, parse_seed
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.task_specs import SUITE_TASKS

_STEPS = ("control_steps", "global_step", "timesteps", "steps", "step")
_RETURN = ("episode_return", "episodic_return", "return", "reward")
"""Default columns, of which the first that a file has is used."""

# Axes of W&B, whose `Step` counts calls of `wandb.log`, and endings of columns without a metric.
_NOT_CONTROL_STEPS = ("Step", "Wall Time", "Relative Time (Wall)", "Relative Time (Process)")
_NO_METRICS = ("__MIN", "__MAX", "_step", "_runtime", "_timestamp")
_MAX_TIME = 1e12  # s since 1970; excludes NaN and infinity


def read_csv(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each seed of a file with a row per point.

    Rows without a return, as in logs of several quantities, are left out.
    """
    table = read_table(file)
    columns = {
        "steps": request.steps_column or next(filter(table.__contains__, _STEPS), _STEPS[0]),
        "return": request.return_column or next(filter(table.__contains__, _RETURN), _RETURN[0]),
    }
    if request.seed_from is None:
        columns["seed"] = request.seed_column or "seed"
        if request.seed_column is None and "seed" not in table:
            raise request.no_seed()
    for role, column in columns.items():
        _check_column(table, file, column, f"--{role}-column")
    table = _with_values(table, columns["return"], file)
    if "seed" in columns:
        seeds = read_seeds(table, columns["seed"], file)
    else:
        seeds = [request.seed_in(str(file.path), "the path")] * len(table)
    kind = request.returns_kind(columns["return"])
    return [
        Series(file, seed, kind, _points(rows, columns, file), columns)
        for seed, rows in table.groupby(pd.Series(seeds, table.index))
    ]


def read_wandb(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each run of a chart that W&B exported.

    The first column is the horizontal axis. A run has the column "RUN - METRIC", and with the
    endings __MIN and __MAX those of the values that W&B has averaged.
    """
    # W&B ends the last line without a line break.
    table = read_table(file, ends_line=False)
    steps = request.steps_column or str(table.columns[0])
    _check_column(table, file, steps, "--steps-column")
    if request.steps_column is None and steps in _NOT_CONTROL_STEPS:
        raise RequestError(
            f"The horizontal axis of {file.path} is {steps!r}, which need not be control steps; "
            f"choose the axis global_step in W&B, or type --steps-column {steps!r} if it is."
        )
    runs: dict[str, dict[str, str]] = {}  # columns of each metric, by run
    for column in map(str, table.columns):
        run, dash, metric = column.rpartition(" - ")
        if dash and not metric.endswith(_NO_METRICS):
            runs.setdefault(metric, {})[run] = column
    metric = request.return_column or (next(iter(runs)) if len(runs) == 1 else "")
    if metric not in runs:
        reason = f"no metric {metric!r}" if metric else "not exactly one metric"
        raise RequestError(
            f"{file.path} has {reason}; type --return-column with one of "
            f"{', '.join(sorted(runs)) or '(none)'}; a chart has columns 'RUN - METRIC'."
        )
    series = []
    for run, column in runs[metric].items():
        columns = {"steps": steps, "return": column}
        points = _points(_with_values(table, column, file), columns, file)
        seed = request.seed_in(run, f"{file.path}, the run")
        series.append(Series(file, seed, request.returns_kind(metric), points, columns))
    return series


def read_monitor(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the episodes of one environment of stable-baselines3, at times of the clock in s."""
    first, _, _ = file.content.partition(b"\n")
    try:
        head: Any = json.loads(first.removeprefix(b"#")) if first[:1] == b"#" else None
    except ValueError:
        head = None
    start = head.get("t_start") if isinstance(head, dict) else None
    if not isinstance(start, int | float) or not abs(start) < _MAX_TIME:
        raise RequestError(
            f'{file.path}, line 1: not a file of a Monitor, which begins with {{"t_start": …}} '
            "after a #."
        )
    for task in (*TASKS, *SUITE_TASKS):
        ids = environment_id(task), environment_id(task, augmented=True)
        if task != request.task and head.get("env_id") in ids:
            raise RequestError(
                f"{file.path} is of {head['env_id']}, which is --task {task}, not {request.task}."
            )
    table = read_table(file, skip=1)
    points = pd.DataFrame(index=table.index)
    for name, column in {"episode_return": "r", "length": "l", "wall_time": "t"}.items():
        _check_column(table, file, column, "--from")
        points[name] = numbers(table, column, file)
    points["control_steps"] = points["length"].cumsum()
    points["wall_time"] += start
    back = np.flatnonzero(np.diff(points["wall_time"]) < 0)
    if len(back):
        raise RequestError(
            f"{file.path}, line {table.index[back[0] + 1]}: the time t goes back, so a second "
            "training was appended; split the file."
        )
    return [Series(file, request.seed_in(str(file.path), "the path"), "training", points)]


def read_table(file: ImportedFile, skip: int = 0, *, ends_line: bool = True) -> pd.DataFrame:
    """Returns the rows of a CSV file as texts, indexed by their line, without lines to skip.

    ends_line: whether the last line of a whole file ends with a line break.
    """
    try:
        text = file.content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise RequestError(f"{file.path} is not a CSV file: it is not text (UTF-8).") from None
    lines = list(io.StringIO(text, newline=""))
    first, last = "".join(lines[skip : skip + 1]), len(lines)
    # The separator that the header has most; spreadsheets of some languages write ;.
    separator = max(",;\t", key=first.count)
    reader = csv.reader(lines[skip:], delimiter=separator, strict=True)
    rows: dict[int, list[str]] = {}
    try:
        for fields in reader:
            if fields:
                rows[skip + reader.line_num] = fields
    except csv.Error as error:
        is_cut = "end of data" in str(error)
        reason = f", line {last}: the file is cut off" if is_cut else f": {error}"
        raise RequestError(f"{file.path}{reason}; it can't be read as CSV.") from None
    header = next(iter(rows.values()), [])
    for line, fields in rows.items():
        if len(fields) != len(header):
            cut = "; the file is cut off" if line == last and len(fields) < len(header) else ""
            raise RequestError(
                f"{file.path}, line {line}: {len(fields)} fields, but the header has "
                f"{len(header)}{cut}."
            )
    if ends_line and not text.endswith(("\n", "\r")):
        raise RequestError(
            f"{file.path}, line {last}: the line has no end, so the file is cut off; copy it "
            "again, or remove that line."
        )
    doubled = {name for name in header if header.count(name) > 1}
    if doubled:
        raise RequestError(f"{file.path} has two columns {min(doubled)!r}; rename one of them.")
    if len(rows) < 2:
        raise RequestError(f"{file.path} has a header, but no rows; leave the file out.")
    return pd.DataFrame(list(rows.values()), pd.Index(rows, name="line"), header).iloc[1:]


def numbers(table: pd.DataFrame, name: str, file: ImportedFile) -> NDArray[np.float64]:
    """Returns a column of `read_table` as finite numbers."""
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        line, text = table.index[bad[0]], table[name].iloc[bad[0]]
        raise RequestError(
            f"{file.path}, line {line}: {name} is {text[:40]!r}, which is not a finite number."
        )
    return values


def read_seeds(table: pd.DataFrame, name: str, file: ImportedFile) -> list[int]:
    """Returns the seeds in a column of `read_table`; raises the error of `parse_seed`."""
    where = f"{file.path}, line"
    return [parse_seed(text, f"{where} {line}: {name} is") for line, text in table[name].items()]


def _check_column(table: pd.DataFrame, file: ImportedFile, name: str, option: str) -> None:
    if name not in table:
        raise RequestError(
            f"{file.path} has no column {name!r}; type {option} with one of "
            f"{', '.join(map(str, table))}."
        )


def _with_values(table: pd.DataFrame, column: str, file: ImportedFile) -> pd.DataFrame:
    rows = table[table[column] != ""]
    if rows.empty:
        raise RequestError(f"{file.path} has no value of {column}; leave it out.")
    return rows


def _points(rows: pd.DataFrame, columns: Mapping[str, str], file: ImportedFile) -> pd.DataFrame:
    points = {"control_steps": columns["steps"], "episode_return": columns["return"]}
    return pd.DataFrame({name: numbers(rows, c, file) for name, c in points.items()}, rows.index)
