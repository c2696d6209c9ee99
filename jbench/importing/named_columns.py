"""Learning curves in CSV files, whose columns have the names that loggers and papers give them."""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Literal

import pandas as pd

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.imported_file import ImportedFile
from jbench.importing.path_names import PathNames, names_in_path, without_seed
from jbench.importing.request import EVALUATION_TAG, RETURN, STEPS, TAGS
from jbench.importing.wandb_chart import is_chart, read_chart
from jbench.wording import are, counted, have, in_prose

_MORE_STEPS = (
    "env_step",
    "env_steps",
    "environment_steps",
    "total_steps",
    "total_timesteps",
    "timestep",
    "time_steps",
    "timesteps_total",
    "total_env_interacts",  # Spinning Up
    "num_env_steps_sampled_lifetime",  # RLlib
    "time/total_timesteps",  # stable-baselines3
    "frames",
)
_MILLIONS = "million_steps"
_MORE_RETURNS = (
    "avg_return",
    "average_return",
    "mean_return",
    "average_test_ep_ret",  # Spinning Up
    "average_ep_ret",
    "episode_return_mean",  # RLlib
    "episode_reward_mean",
    "episode_reward",
    EVALUATION_TAG,
    "mean_reward",
    *TAGS,
    "score",
)

_NAMES = {
    "method": ("method", "algo", "algorithm", "agent", "exp_name", "experiment"),
    "task": ("task", "env", "env_name", "env_id", "environment", "game"),
    "seed": ("seed", "random_seed"),
    # A `step` beside one of them counts something else, such as updates.
    "steps": ("steps", *STEPS[:-1], *_MORE_STEPS, _MILLIONS, STEPS[-1]),
    "return": tuple(dict.fromkeys(("return", *RETURN, *_MORE_RETURNS))),
}
"""Names of the columns of a CSV file, of which the first that it has is used."""

_GROUP = re.compile(r"^(.*/)?(eval_|train_)?")
"""What a metric's name may have before the name of the number."""

_LOGS = ("progress", "log", "eval", "evaluations", "train", "monitor", "metrics", "results")
"""Names of files that say nothing of their run."""

_METRIC = ("metric", "metrics", "tag", "key")
_VALUE = "value"
"""Columns of a file that has a row for each value of each metric."""


def read_named_columns(file: ImportedFile) -> tables.CurveFile:
    """Reads a CSV file with a row for each point, or for each value of each metric.

    Raises:
        RequestError: if it lacks a column, or has a value that is none.
    """
    # Spreadsheets end the last line without a line break.
    table = tables.read_table(file, ends_line=False)
    if is_chart(table):
        return read_chart(table, file)

    columns, notes = known_columns(table, file)
    named = _by_usual_name(table)
    metric = next((named[name] for name in _METRIC if name in named), None)
    if "return" not in columns and metric is not None and _VALUE in named:
        columns["return"] = named[_VALUE]
        table, notes_on_metrics = _only_returns(table, metric, file)
        notes += notes_on_metrics

    names = names_in_path(file.path)
    for role in ("seed", "steps", "return"):
        if role not in columns and not (role == "seed" and names.has_seed):
            raise _lacks(role, table, file)

    numeric = {role: columns[role] for role in ("steps", "return")}
    every = table
    table = tables.rows_with_value(table, numeric["return"])
    if table.empty:
        raise RequestError(f"{file.path} has no value of {numeric['return']}; leave it out.")

    labels = [columns[role] for role in ("task", "method", "seed") if role in columns]
    notes += _notes_on_empty_runs(every, table, labels, file)
    points = tables.numbers(table, numeric, file)
    points["steps"] = single_steps(points["steps"], numeric["steps"])
    if "seed" in columns:
        points["seed"] = tables.seeds(table, columns["seed"], file)
    else:
        points["seed"] = names.seed
        notes.append(f"{file.path.name} has no column with the seed; its path has {names.seed}.")

    instead = _labels_in_path(file.path, names, has_task="task" in columns)
    for role in ("task", "method"):
        if role in columns:
            points[role] = table[columns[role]].str.strip()  # some put a space after commas
        else:
            label, where = instead[role]
            points[role] = label
            notes.append(
                f"{file.path.name} has no column with the {role}; it is called {label}, as the "
                f"{where}."
            )

    return tables.CurveFile(points, notes)


def _notes_on_empty_runs(
    every: pd.DataFrame, kept: pd.DataFrame, labels: Sequence[str], file: ImportedFile
) -> list[str]:
    """Returns a note on the runs of a file without any return, which may have failed.

    Args:
        every: all rows of the file.
        kept: those with a return.
        labels: columns that name a run; rows that lack one of them are none of a run.
    """
    if not labels:
        return []

    runs, with_returns = (
        dict.fromkeys(
            tuple(label.strip() for label in run)
            for run in rows[labels].drop_duplicates().itertuples(index=False)
        )
        for rows in (every, kept)
    )
    empty = [run for run in runs if all(run) and run not in with_returns]
    if not empty:
        return []

    count = len(empty)
    first = ", ".join(f"{name} {label}" for name, label in zip(labels, empty[0], strict=True))
    such = "" if count == 1 else "such as "
    runs_of_file = f"{counted(count, 'run')} of {file.path.name}, {such}{first},"
    return [
        f"{runs_of_file} {have(count)} no return and {are(count)} left out; if training failed, "
        "the method looks better than it is."
    ]


def _lacks(role: str, table: pd.DataFrame, file: ImportedFile) -> RequestError:
    """Returns the error for a file that lacks a column."""
    advice = "add or rename it"
    if role == "seed":
        advice += ", or put it into a name of the path, such as seed0"

    others = in_prose(_NAMES[role][1:4] or _NAMES[role])
    return RequestError(
        f"{file.path} has no column {role!r}; {advice}: the file needs "
        f"{', '.join(_NAMES)} (or names such as {others}), but has {', '.join(map(str, table))}."
    )


def _labels_in_path(
    path: Path, names: PathNames, *, has_task: bool
) -> dict[str, tuple[str, Literal["file", "folder"]]]:
    """Returns the task and the method that a path has, each with the part of the path.

    A file is named for its task, or for its method if it has a column with the task. A file that a
    logger has named says nothing.
    """
    stem = without_seed(path.stem)
    if stem and _usual(stem) not in _LOGS:
        if has_task:
            return {"task": (stem, "file"), "method": (stem, "file")}
        return {"task": (stem, "file"), "method": (names.task, "folder")}

    if has_task:
        return {"task": (names.task, "folder"), "method": (names.task, "folder")}
    return {"task": (names.task, "folder"), "method": (names.method, "folder")}


def single_steps(steps: pd.Series, column: str) -> pd.Series:
    """Returns control steps of a column, which may count them in millions by its name."""
    if _usual(column) == _MILLIONS:
        return (steps * 1e6).round()
    return steps


def _by_usual_name(table: pd.DataFrame) -> dict[str, str]:
    """Returns the columns of a table by their usual names, the first one of each."""
    return {_usual(column): column for column in reversed(list(map(str, table)))}


def known_columns(table: pd.DataFrame, file: ImportedFile) -> tuple[dict[str, str], list[str]]:
    """Returns the column of each role that a table has, and notes on others that may be meant.

    The roles are method, task, seed, steps and return.
    """
    named = _by_usual_name(table)
    in_groups: dict[str, list[str]] = {}
    for column in map(str, table):
        name = _usual(column)
        if "/" in name:  # of a tracker, such as config/seed
            in_groups.setdefault(_GROUP.sub("", name), []).append(column)

    columns: dict[str, str] = {}
    notes = []
    for role, names in _NAMES.items():
        candidates = [named[name] for name in names if name in named]
        if not candidates:
            candidates = [*chain.from_iterable(in_groups.get(name, []) for name in names)]
            candidates.sort(key=lambda column: not _usual(column).startswith("eval"))

        if candidates:
            columns[role] = candidates[0]
        if role == "return" and len(candidates) > 1:
            others = in_prose(candidates[1:], "and")
            notes.append(f"The return in {file.path.name} is {candidates[0]}, not {others}.")

    return columns, notes


def _usual(column: str) -> str:
    """Returns the name of a column in lower case with underscores."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", column.strip())
    return words.lower().replace(" ", "_").replace("-", "_")


def _only_returns(
    table: pd.DataFrame, metric: str, file: ImportedFile
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the rows of the only metric that is a return, and a note if there may be doubt."""
    metrics = [str(name) for name in table[metric].unique()]
    known = [name for name in metrics if _usual(name) in _NAMES["return"]]
    # In a group of a tracker, such as eval/return.
    known = known or [name for name in metrics if _GROUP.sub("", _usual(name)) in _NAMES["return"]]
    if len(metrics) == 1:
        if known:
            return table, []
        return table, [f"{file.path.name} has one metric, {metrics[0]}, taken for the return."]

    if len(known) == 1:
        (chosen,) = known
        note = f"Of the metrics in {file.path.name}, {chosen} is shown."
        return table[table[metric] == chosen], [note]

    returns = "none is a return"
    if known:
        returns = f"{in_prose(known, 'and')} are returns"

    raise RequestError(
        f"{file.path} has the metrics {', '.join(metrics)} in the column {metric!r}; by their "
        f"names {returns}: keep the rows of one, or call it return."
    )
