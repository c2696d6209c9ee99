"""CSV files with columns of any name, and those that the charts of W&B export."""

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.reader import Series, check_columns, check_points, numbers, read_table
from jbench.importing.request import ImportedFile, ImportRequest, parse_seed

STEPS = ("control_steps", "global_step", "timesteps", "steps", "step")
RETURN = ("episode_return", "episodic_return", "return", "reward")
SEED = "seed"
"""Default columns, of which the first that a file has is used."""

_NOT_CONTROL_STEPS = ("Step", "Wall Time", "Relative Time (Wall)", "Relative Time (Process)")
"""Axes of W&B; its `Step` counts calls of `wandb.log`."""

_NO_METRICS = ("__MIN", "__MAX", "_step", "_runtime", "_timestamp")
"""Endings of columns of W&B that are not a metric."""


def read_csv(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each seed of a file with a row per point.

    Rows without a return, as in logs of several quantities, are left out.

    Raises:
        RequestError: if it is not a whole CSV file, or lacks a column.
    """
    table = read_table(file)
    columns = {
        "steps": request.steps_column or next(filter(table.__contains__, STEPS), STEPS[0]),
        "return": request.return_column or next(filter(table.__contains__, RETURN), RETURN[0]),
    }
    if request.seed_column is not None:
        columns["seed"] = request.seed_column
    elif request.seed_from is None:
        if SEED not in table:
            raise request.no_seed()
        columns["seed"] = SEED
    check_columns(table, file, {f"--{role}-column": column for role, column in columns.items()})
    table = _with_values(table, columns["return"], file)
    kind = request.returns_kind(columns["return"])
    if "seed" in columns:
        where = f"{columns['seed']} is"
        seeds = [
            parse_seed(text, f"{file.path}, line {line}: {where}")
            for line, text in table[columns["seed"]].items()
        ]
    else:
        seeds = [request.seed_in(str(file.path), "the path")] * len(table)
    return [
        Series(file, seed, kind, _points(rows, columns, file), columns)
        for seed, rows in table.groupby(pd.Series(seeds, table.index))
    ]


def read_wandb(file: ImportedFile, request: ImportRequest) -> list[Series]:
    """Returns the learning curve of each run of a chart that W&B exported.

    The first column is the horizontal axis. A run has the column "RUN - METRIC", and with the
    endings __MIN and __MAX those of the values that W&B has averaged.

    Raises:
        RequestError: if it is not a whole file of this form.
    """
    # W&B ends the last line without a line break.
    table = read_table(file, ends_line=False)
    steps = request.steps_column or str(table.columns[0])
    check_columns(table, file, {"--steps-column": steps})
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


def _with_values(table: pd.DataFrame, column: str, file: ImportedFile) -> pd.DataFrame:
    """Returns the rows that have a value in a column."""
    rows = table[table[column] != ""]
    if rows.empty:
        raise RequestError(f"{file.path} has no value of {column}; leave it out.")
    return rows


def _points(rows: pd.DataFrame, columns: dict[str, str], file: ImportedFile) -> pd.DataFrame:
    """Returns the points of a learning curve; see `Series.points`."""
    points = pd.DataFrame(
        {
            "control_steps": numbers(rows, columns["steps"], file),
            "episode_return": numbers(rows, columns["return"], file),
        }
    )
    check_points(points, file, lambda row: f"line {rows.index[row]}")
    return points
