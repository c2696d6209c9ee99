"""CSV files with columns of any name, and those that the charts of W&B export."""

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.request import ImportedFile, ImportRequest, seed_of
from jbench.importing.series import Series, check_points, numbers
from jbench.importing.table import check_columns, read_table

STEPS = ("control_steps", "global_step", "timesteps", "steps", "step")
RETURN = ("episode_return", "episodic_return", "return", "reward")
SEED = "seed"
"""Default columns, of which the first that a file has is used."""

_NOT_CONTROL_STEPS = ("Step", "Wall Time", "Relative Time (Wall)", "Relative Time (Process)")
"""Axes of W&B; its `Step` counts calls of `wandb.log`."""

_SIDES = ("__MIN", "__MAX")
_OF_WANDB = ("_step", "_runtime", "_timestamp")


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
    for name, column in columns.items():
        check_columns(table, file, f"--{name}-column", column)
    table = _with_values(table, columns["return"], file)
    kind = request.kind_of(columns["return"])
    if "seed" not in columns:
        seeds = [request.seed_in(str(file.path), "the path")] * len(table)
    else:
        found = zip(table.index, table[columns["seed"]], strict=True)
        named = f"{columns['seed']} is"
        seeds = [seed_of(text, f"{file.path}, line {line}: {named}") for line, text in found]
    return [
        Series(file, seed, kind, _points(rows, columns["steps"], columns["return"], file), columns)
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
    check_columns(table, file, "--steps-column", steps)
    if request.steps_column is None and steps in _NOT_CONTROL_STEPS:
        raise RequestError(
            f"The horizontal axis of {file.path} is {steps!r}, which need not be control steps; "
            f"choose the axis global_step in W&B, or type --steps-column {steps!r} if it is."
        )
    found = _metrics(table)
    metric = request.return_column
    if metric is None and len(found) == 1:
        metric = next(iter(found))
    if metric is None or metric not in found:
        reason = f"no metric {metric!r}" if metric else "not exactly one metric"
        raise RequestError(
            f"{file.path} has {reason}; type --return-column with one of "
            f"{', '.join(sorted(found)) or '(none)'}; a chart has columns 'RUN - METRIC'."
        )
    series = []
    for run, column in found[metric].items():
        rows = _with_values(table, column, file)
        seed = request.seed_in(run, f"{file.path}, the run")
        columns = {"steps": steps, "return": column}
        points = _points(rows, steps, column, file)
        series.append(Series(file, seed, request.kind_of(metric), points, columns))
    return series


def _metrics(table: pd.DataFrame) -> dict[str, dict[str, str]]:
    """Returns the columns of each metric by run."""
    found: dict[str, dict[str, str]] = {}
    for column in map(str, table.columns):
        run, dash, metric = column.rpartition(" - ")
        if dash and not metric.endswith(_SIDES) and metric not in _OF_WANDB:
            found.setdefault(metric, {})[run] = column
    return found


def _with_values(table: pd.DataFrame, column: str, file: ImportedFile) -> pd.DataFrame:
    """Returns the rows that have a value in a column."""
    rows = table[table[column] != ""]
    if rows.empty:
        raise RequestError(f"{file.path} has no value of {column}; leave it out.")
    return rows


def _points(rows: pd.DataFrame, steps: str, returns: str, file: ImportedFile) -> pd.DataFrame:
    """Returns the points of a learning curve; see `Series.points`."""
    points = pd.DataFrame(
        {
            "control_steps": numbers(rows, steps, file),
            "episode_return": numbers(rows, returns, file),
        }
    )
    check_points(points, file, lambda row: f"line {rows.index[row]}")
    return points
