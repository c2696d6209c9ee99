"""Learning curves of any environment in files of the forms in which people publish and log them."""

import re
from codecs import BOM_UTF8
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.event_file import read_event_file
from jbench.importing.foreign import is_of_tensorboard
from jbench.importing.json_curves import curves_by_task, listed_curves
from jbench.importing.named_columns import read_named_columns
from jbench.importing.path_names import PathNames, names_in_path
from jbench.importing.readers import Series, read_evaluations, read_monitor
from jbench.importing.request import EVALUATION_TAG, TAGS
from jbench.importing.resumed import continued, in_order
from jbench.names import ReturnsName, in_prose
from jbench.wording import counted

_RUN = ["task", "method", "seed"]
_COLUMNS = [*_RUN, "steps", "return"]

_MOST = 1e15
"""Largest return; differences and sums of larger ones are no longer exact numbers."""

_MONITOR = re.compile(rb"#\s*{")
"""Beginning of the file of a Monitor."""


def read_curves(path: Path, returns: ReturnsName = "evaluation") -> tables.CurveFile:
    """Reads a file of curves, or all files in a folder.

    A file is CSV with a row for each point, whose columns have any of the usual names, the JSON of
    HumanoidBench or DreamerV3, an `evaluations.npz` or a Monitor's file of stable-baselines3, or
    one of TensorBoard. Of a folder that has files of stable-baselines3, those with the kind of
    returns are read.

    Raises:
        RequestError: if it can't be read, lacks a column, or has a value that is none.
    """
    parts = []
    of_tensorboard = []
    for file in map(tables.open_file, _files(path, returns)):
        if is_of_tensorboard(file.content):
            of_tensorboard.append(file)
        else:
            parts.append(_read(file))

    if of_tensorboard:
        parts.append(_from_events(of_tensorboard, returns))

    points = pd.concat([part.points for part in parts], ignore_index=True)
    if "wall_time" in points:  # of Monitors, of which a run has one for each of its environments
        points = points.sort_values("wall_time", kind="stable", ignore_index=True)
        counted_steps = points.groupby(_RUN)["length"].cumsum()
        points["steps"] = counted_steps.fillna(points["steps"])
    points = points[_COLUMNS]
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    return tables.CurveFile(_checked(points, path), notes)


def _files(path: Path, returns: ReturnsName) -> Sequence[Path]:
    """Returns the files of a folder that have curves, of the kind of return that is asked for."""
    if not path.is_dir():
        return [path]

    of_sb3 = [("*monitor.csv",), ("evaluations*.npz",)]
    if returns == "evaluation":
        of_sb3.reverse()

    for patterns in (*of_sb3, ("*.csv", "*.json"), ("progress.txt",), ("*.tfevents.*",)):
        if found := sorted(file for pattern in patterns for file in path.rglob(pattern)):
            return found

    raise RequestError(
        f"{path} is a directory without a .csv, .json, .npz or event file; name a file."
    )


def _read(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads a file by its first bytes, whatever its name is."""
    start = file.content.removeprefix(BOM_UTF8).lstrip()
    if start.startswith(b"{"):
        return tables.CurveFile(curves_by_task(file), [])
    if start.startswith(b"["):
        return tables.CurveFile(listed_curves(file), [])
    if _MONITOR.match(start):
        return _from_monitor(file)
    if start.startswith(b"PK"):
        return _from_evaluations(file)
    return read_named_columns(file)


def _checked(points: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Returns points in order; raises a RequestError if they can't be those of curves."""

    def check(is_right: pd.Series, reason: str) -> None:
        if not is_right.all():
            row = points[~is_right].iloc[0]
            where = f"{path}: {row['method'][:40]!r} on {row['task'][:40]!r}, seed {row['seed']}"
            raise RequestError(f"{where}: {reason.format(**row)}.")

    for name in ("task", "method"):
        for text in points[name].unique():
            if not (text.strip() and text.isprintable()):
                raise RequestError(f"{path}: {text[:40]!r} is no name of a {name}; rename it.")

    is_count = points["steps"].between(0, tables.MAX_STEPS) & (points["steps"] % 1 == 0)
    check(
        is_count,
        "{steps:g} is no number of steps; if steps are in millions, call the column million_steps",
    )
    check(
        points["return"].abs() <= _MOST,
        f"the return {{return:g}} is not between -{_MOST:g} and {_MOST:g}",
    )
    runs = points.groupby(_RUN)["steps"]
    check(
        (runs.transform("max") > 0) | (runs.transform("size") == 1),
        "all of its points are at 0 steps; export the curve with its steps",
    )
    points = points.astype({"steps": np.int64}).sort_values(_COLUMNS, ignore_index=True)
    doubled = points.duplicated(_COLUMNS[:-1])
    check(~doubled, "two returns at {steps:,} steps; remove one of them")
    return points


def _from_evaluations(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads the evaluations of a run of stable-baselines3, whose names are those of folders."""
    points = read_evaluations(file)
    if points.empty:
        raise RequestError(f"{file.path} has no evaluation; leave the file out.")

    bad = points[~np.isfinite(points[["control_steps", "episode_return"]]).all(axis=1)]
    if len(bad):
        number = bad["point"].iloc[0] + 1
        raise RequestError(f"{file.path}, evaluation {number}: not a finite number.")

    points = points.rename(columns={"control_steps": "steps", "episode_return": "return"})
    means = points.groupby("point", as_index=False)[["steps", "return"]].mean()
    names = names_in_path(file.path)
    return tables.CurveFile(_labelled(means, names), [_note_on_path(file.path, names)])


def _from_monitor(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads the training episodes of a run, of which a later part may have been appended."""
    monitor = read_monitor(file)
    names = names_in_path(file.path)
    if monitor.env_id not in ("", "None"):
        names = names._replace(task=monitor.env_id)
    notes = [_note_on_path(file.path, names)]
    if monitor.restarts:
        notes.append(
            f"The time goes back {counted(len(monitor.restarts), 'time')} in {file.path.name}: it "
            "is read as one training that was resumed."
        )

    points = monitor.points.rename(columns={"control_steps": "steps", "episode_return": "return"})
    return tables.CurveFile(_labelled(points, names), notes)


def _from_events(files: Sequence[tables.ImportedFile], returns: ReturnsName) -> tables.CurveFile:
    """Reads the returns of runs in TensorBoard, whose names are those of folders.

    A run that was resumed has several files.
    """
    runs: dict[tuple[str, str, int], list[Series]] = {}
    notes: list[str] = []
    for file in files:
        names = names_in_path(file.path)
        part, more = _scalars(file, names.seed, returns)
        runs.setdefault((names.task, names.method, names.seed), []).append(part)
        notes += [_note_on_path(file.path, names), *more]

    curves = []
    for (task, method, seed), parts in runs.items():
        points = pd.concat(continued(in_order(parts)), ignore_index=True)
        points = points.rename(columns={"control_steps": "steps", "episode_return": "return"})
        # Episodes of several environments may end at one step.
        means = points.groupby("steps", as_index=False)[["steps", "return"]].mean()
        if len(means) < len(points):
            tag = parts[0].columns["return"]
            notes.append(f"Values of {tag} at the same step of a run are averaged.")
        if len(parts) > 1:
            notes.append(
                f"The {len(parts)} event files of {method} on {task}, seed {seed}, are read as one "
                "training that was resumed."
            )

        curves.append(means.assign(task=task, method=method, seed=seed))

    return tables.CurveFile(pd.concat(curves, ignore_index=True), notes)


def _scalars(
    file: tables.ImportedFile, seed: int, returns: ReturnsName
) -> tuple[Series, list[str]]:
    """Returns the returns in a file of TensorBoard, and a note on other tags that it has."""
    events = read_event_file(file)
    scalars = events.scalars
    known = [EVALUATION_TAG, *TAGS] if returns == "evaluation" else [*TAGS]
    tag = next((tag for tag in known if tag in scalars), None)
    if tag is None:
        found = ", ".join(sorted(scalars)) or "none"
        raise RequestError(
            f"{file.path} has no tag {in_prose(known)}; write a CSV file of one of its tags: "
            f"{found}."
        )

    points = pd.DataFrame(scalars[tag], columns=["control_steps", "wall_time", "episode_return"])
    if not np.isfinite(points["episode_return"]).all():
        raise RequestError(f"{file.path}: a value of {tag} is not a finite number.")

    others = [other for other in (EVALUATION_TAG, *TAGS) if other in scalars and other != tag]
    notes = []
    if others:
        notes.append(f"Of the tags in {file.path.name}, {tag} is shown, not {in_prose(others)}.")

    return Series(file, seed, returns, points, {"return": tag}, events.resumed_at), notes


def _labelled(points: pd.DataFrame, names: PathNames) -> pd.DataFrame:
    """Returns points with the labels of their run."""
    return points.assign(task=names.task, method=names.method, seed=names.seed)


def _note_on_path(path: Path, names: PathNames) -> str:
    """Returns what a reader has to know of labels that a file lacks."""
    return (
        f"{path.resolve().parent.name}/{path.name}: method {names.method}, task {names.task} and "
        f"seed {names.seed} are those of its path."
    )
