"""A chart that W&B exported as CSV: a horizontal axis, and a column for each run.

A run has the column "RUN - METRIC", and with the endings __MIN and __MAX those of the values that
W&B has averaged.
"""

import pandas as pd

from jbench.errors import RequestError
from jbench.importing.imported_file import ImportedFile
from jbench.importing.path_names import names_of_run
from jbench.importing.tables import CurveFile, numbers, rows_with_value

NOT_CONTROL_STEPS = ("Step", "Wall Time", "Relative Time (Wall)", "Relative Time (Process)")
"""Axes of W&B that are none of a training's control steps: `Step` counts calls of `wandb.log`."""

_NO_METRICS = ("__MIN", "__MAX", "_step", "_runtime", "_timestamp")
"""Endings of columns without a metric."""


def is_chart(table: pd.DataFrame) -> bool:
    """Returns whether all columns but the first are those of runs."""
    columns = list(map(str, table))
    return len(columns) > 1 and all(" - " in column for column in columns[1:])


def columns_of_runs(table: pd.DataFrame) -> dict[str, dict[str, str]]:
    """Returns the columns of each metric, by run."""
    by_metric: dict[str, dict[str, str]] = {}
    for column in map(str, table):
        run, dash, metric = column.rpartition(" - ")
        if dash and not metric.endswith(_NO_METRICS):
            by_metric.setdefault(metric, {})[run] = column
    return by_metric


def read_chart(table: pd.DataFrame, file: ImportedFile) -> CurveFile:
    """Returns the curves of the runs of a chart, whose labels are in their names.

    Raises a RequestError if the axis need not be control steps, the chart has not one metric, or
    two runs have the same labels.
    """
    axis = str(table.columns[0])
    if axis in NOT_CONTROL_STEPS:
        raise RequestError(
            f"The horizontal axis of {file.path} is {axis!r}, which need not be control steps; "
            "choose the axis global_step in W&B, or call the column global_step if it is that."
        )

    by_metric = columns_of_runs(table)
    if len(by_metric) != 1:
        found = ", ".join(sorted(by_metric)) or "none"
        raise RequestError(
            f"{file.path} is a chart of W&B with the metrics {found}; export a chart of one."
        )

    ((metric, runs),) = by_metric.items()
    labelled: dict[tuple[str, str, int], str] = {}
    curves = []
    for run, column in runs.items():
        names = names_of_run(run, file.path)
        labels = (names.task, names.method, names.seed)
        if labels in labelled:
            raise RequestError(
                f"{file.path}: the runs {labelled[labels]} and {run} are both seed {names.seed} of "
                f"{names.method}; write their seeds into their names, as in sac-seed-3."
            )

        labelled[labels] = run
        rows = rows_with_value(table, column)
        points = numbers(rows, {"steps": axis, "return": column}, file)
        curves.append(points.assign(task=names.task, method=names.method, seed=names.seed))

    task, method, seed = next(iter(labelled))
    first = labelled[task, method, seed]
    note = (
        f"{file.path.name} is a chart of {metric} over {axis}: the names of its runs say that "
        f"{first} is seed {seed} of method {method} on task {task}, and so on."
    )
    return CurveFile(pd.concat(curves, ignore_index=True), [note])
