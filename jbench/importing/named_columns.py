"""Learning curves in CSV files, whose columns have the names that loggers and papers give them."""

import re

import pandas as pd

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.request import RETURN, STEPS, TAGS
from jbench.names import in_prose

_MORE_STEPS = (
    "env_step",
    "env_steps",
    "environment_steps",
    "total_steps",
    "total_timesteps",
    "timestep",
    "frames",
)
_MILLIONS = "million_steps"
_MORE_RETURNS = (
    "avg_return",
    "mean_return",
    "episode_reward",
    "mean_reward",
    "eval/mean_reward",
    *TAGS,
    "score",
)

_NAMES = {
    "method": ("method", "algo", "algorithm", "agent", "exp_name", "experiment"),
    "task": ("task", "env", "env_name", "env_id", "environment", "game"),
    "seed": ("seed", "random_seed"),
    # A `step` beside one of them counts something else, such as updates.
    "steps": ("steps", *STEPS[:-1], *_MORE_STEPS, _MILLIONS, STEPS[-1]),
    "return": ("return", *RETURN, *_MORE_RETURNS),
}
"""Names of the columns of a CSV file, of which the first that it has is used."""

_GROUP = re.compile(r"^(.*/)?(eval_|train_)?")
"""What a metric's name may have before the name of the number."""

_METRIC = ("metric", "metrics", "tag", "key")
_VALUE = "value"
"""Columns of a file that has a row for each value of each metric."""


def read_named_columns(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads a CSV file with a row for each point, or for each value of each metric.

    Raises:
        RequestError: if it lacks a column, or has a value that is none.
    """
    # Spreadsheets end the last line without a line break.
    table = tables.read_table(file, ends_line=False)
    notes = []
    named = {_usual(column): column for column in reversed(list(map(str, table)))}
    columns = {
        role: next((named[name] for name in names if name in named), None)
        for role, names in _NAMES.items()
    }
    metric = next((named[name] for name in _METRIC if name in named), None)
    if columns["return"] is None and metric is not None and _VALUE in named:
        columns["return"] = named[_VALUE]
        table, kept = _only_returns(table, metric, file)
        notes += kept

    for role in ("seed", "steps", "return"):
        if columns[role] is None:
            raise RequestError(
                f"{file.path} has no column {role!r}; it needs {', '.join(_NAMES)} (or names such "
                f"as {in_prose(_NAMES[role][1:4] or _NAMES[role])}), but has "
                f"{', '.join(map(str, table))}."
            )

    numeric = {role: str(columns[role]) for role in ("steps", "return")}
    # A logger leaves the returns of rows without one empty.
    table = table[table[numeric["return"]].str.strip() != ""]
    if table.empty:
        raise RequestError(f"{file.path} has no value of {numeric['return']}; leave it out.")

    points = tables.numbers(table, numeric, file)
    if _usual(numeric["steps"]) == _MILLIONS:
        points["steps"] = (points["steps"] * 1e6).round()

    points["seed"] = tables.seeds(table, str(columns["seed"]), file)
    stem = file.path.stem
    folder = file.path.resolve().parent.name
    instead = {"task": stem, "method": folder if columns["task"] is None else stem}
    for role in ("task", "method"):
        column = columns[role]
        if column is not None:
            points[role] = table[column].str.strip()  # some writers put a space after commas
        else:
            points[role] = instead[role] or role
            where = "folder" if instead[role] == folder else "file"
            notes.append(
                f"{file.path.name} has no column with the {role}; it is called "
                f"{points[role].iloc[0]}, as the {where}."
            )

    return tables.CurveFile(points, notes)


def _usual(column: str) -> str:
    """Returns the name of a column in lower case with underscores."""
    return column.strip().lower().replace(" ", "_").replace("-", "_")


def _only_returns(
    table: pd.DataFrame, metric: str, file: tables.ImportedFile
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the rows of the only metric that is a return, and a note on the others."""
    metrics = [str(name) for name in table[metric].unique()]
    known = [name for name in metrics if _usual(name) in _NAMES["return"]]
    # In a group of a tracker, such as eval/return.
    known = known or [name for name in metrics if _GROUP.sub("", _usual(name)) in _NAMES["return"]]
    chosen = metrics if len(metrics) == 1 else known
    if len(chosen) != 1:
        found = f"{in_prose(known, 'and')} are returns" if known else "none is a return"
        raise RequestError(
            f"{file.path} has the metrics {', '.join(metrics)} in the column {metric!r}; by their "
            f"names {found}: keep the rows of one, or call it return."
        )

    others = [name for name in metrics if name != chosen[0]]
    notes = [f"Of the metrics in {file.path.name}, {chosen[0]} is shown."] if others else []
    return table[table[metric] == chosen[0]], notes
