"""Learning curves of any environment in files of the forms in which people publish and log them."""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.event_file import Events, read_event_file
from jbench.importing.folder import curve_files
from jbench.importing.foreign import is_of_monitor, is_of_tensorboard
from jbench.importing.imported_file import ImportedFile, open_file
from jbench.importing.json_curves import curves_by_task, listed_curves
from jbench.importing.named_columns import read_named_columns
from jbench.importing.path_names import PathNames, names_in_path, notes_on_names
from jbench.importing.readers import Series
from jbench.importing.request import EVALUATION_TAG, TAGS
from jbench.importing.resumed import continued, in_order
from jbench.importing.sb3_files import read_evaluations, read_monitor
from jbench.names import ReturnsName
from jbench.wording import counted, in_prose

_RUN = ["task", "method", "seed"]
_COLUMNS = [*_RUN, "steps", "return"]

_MOST = 1e15
"""Largest return; differences and sums of larger ones are no longer exact numbers."""


def read_curves(path: Path, returns: ReturnsName = "evaluation") -> tables.CurveFile:
    """Reads a file of curves, or all files in a folder.

    A file is CSV with a row for each point, whose columns have any of the usual names, the JSON of
    HumanoidBench or DreamerV3, an `evaluations.npz` or a Monitor's file of stable-baselines3, or
    one of TensorBoard. Of a folder, the files of one kind are read: where it has files of
    stable-baselines3, those with the kind of returns.

    Raises:
        RequestError: if it can't be read, lacks a column, or has a value that is none.
    """
    parts = []
    of_tensorboard = []
    found = curve_files(path, returns)
    for file in map(open_file, found.files):
        if is_of_tensorboard(file.content):
            of_tensorboard.append(file)
        else:
            parts.append(_read(file, returns))

    if of_tensorboard:
        parts.append(_from_events(of_tensorboard, returns, path))

    points = pd.concat([part.points for part in parts], ignore_index=True)
    if "wall_time" in points:  # of Monitors, of which a run has one for each of its environments
        points = points.sort_values("wall_time", kind="stable", ignore_index=True)
        counted_steps = points.groupby(_RUN)["length"].cumsum()
        points["steps"] = counted_steps.fillna(points["steps"])
    points = points[_COLUMNS]
    named = chain.from_iterable(part.named for part in parts)
    notes_of_files = dict.fromkeys(chain.from_iterable(part.notes for part in parts))
    notes = [*found.notes, *notes_on_names(named), *notes_of_files]
    return tables.CurveFile(_checked(points, path), notes)


def _read(file: ImportedFile, returns: ReturnsName) -> tables.CurveFile:
    """Reads a file by its first bytes, whatever its name is."""
    start = file.content.lstrip()
    if start.startswith(b"{"):
        return tables.CurveFile(curves_by_task(file), [])
    if start.startswith(b"["):
        return tables.CurveFile(listed_curves(file), [])
    if is_of_monitor(start):
        return _from_monitor(file, returns)
    if start.startswith(b"PK"):
        return _from_evaluations(file)
    return read_named_columns(file)


def _checked(points: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Returns points in order; raises a RequestError if they can't be those of curves."""

    def check(is_right: pd.Series, reason: Callable[[pd.Series], str]) -> None:
        if not is_right.all():
            row = points[~is_right].iloc[0]
            where = f"{path}: {row['method'][:40]!r} on {row['task'][:40]!r}, seed {row['seed']}"
            raise RequestError(f"{where}: {reason(row)}.")

    for name in ("task", "method"):
        for text in points[name].unique():
            if not (text.strip() and text.isprintable()):
                raise RequestError(f"{path}: {text[:40]!r} is no name of a {name}; rename it.")

    is_count = points["steps"].between(0, tables.MAX_STEPS) & (points["steps"] % 1 == 0)
    check(
        is_count,
        lambda row: (
            f"{row['steps']:g} is no number of steps; if steps are in millions, call the column "
            "million_steps"
        ),
    )
    check(
        points["return"].abs() <= _MOST,
        lambda row: f"the return {row['return']:g} is not between -{_MOST:g} and {_MOST:g}",
    )
    runs = points.groupby(_RUN)["steps"]
    check(
        (runs.transform("max") > 0) | (runs.transform("size") == 1),
        lambda _: "all of its points are at 0 steps; export the curve with its steps",
    )
    points = points.astype({"steps": np.int64}).sort_values(_COLUMNS, ignore_index=True)
    doubled = points.duplicated(_COLUMNS[:-1])
    check(~doubled, lambda row: f"two returns at {row['steps']:,} steps; remove one of them")
    return points


def _from_evaluations(file: ImportedFile) -> tables.CurveFile:
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
    return tables.CurveFile(_labelled(means, names), [], [names])


def _from_monitor(file: ImportedFile, returns: ReturnsName) -> tables.CurveFile:
    """Reads the training episodes of a run, of which a later part may have been appended."""
    monitor = read_monitor(file)
    names = names_in_path(file.path)
    if monitor.env_id not in ("", "None"):
        names = names._replace(task=monitor.env_id, is_task_of_path=False)

    notes = []
    if returns == "evaluation":
        notes.append(_note_on_training("a Monitor"))
    if monitor.restarts:
        notes.append(
            f"The time goes back {counted(len(monitor.restarts), 'time')} in {file.path.name}: it "
            "is read as one training that was resumed."
        )

    points = monitor.points.rename(columns={"control_steps": "steps", "episode_return": "return"})
    return tables.CurveFile(_labelled(points, names), notes, [names])


def _note_on_training(source: str) -> str:
    """Returns the note on files without evaluations, where those were asked for."""
    return (
        f"Each return of {source} is that of a training episode; --returns training smooths them, "
        "and takes the mean of the last ones as final return."
    )


def _from_events(
    files: Sequence[ImportedFile], returns: ReturnsName, path: Path
) -> tables.CurveFile:
    """Reads the returns of runs in TensorBoard, whose names are those of folders.

    A run that was resumed has several files. A file without any scalar, as of a program that ended
    at once, is left out.
    """
    runs: dict[tuple[str, str, int], list[Series]] = {}
    named: list[PathNames] = []
    left_out: dict[str, list[str]] = {}
    empty: list[Path] = []
    for file in files:
        events = read_event_file(file)
        if not events.scalars and len(files) > 1:
            empty.append(file.path)
            continue

        names = names_in_path(file.path)
        part, note = _scalars(file, events, names.seed, returns)
        runs.setdefault((names.task, names.method, names.seed), []).append(part)
        named.append(names)
        if note:
            left_out.setdefault(note, []).append(file.path.name)

    if not runs:
        raise RequestError(f"No event file in {path} has a scalar; name a folder of trainings.")

    notes = _notes_on_events(left_out, empty)
    tags = {part.columns["return"] for part in chain.from_iterable(runs.values())}
    if returns == "evaluation" and TAGS[0] in tags:
        notes.append(_note_on_training(TAGS[0]))

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

    return tables.CurveFile(pd.concat(curves, ignore_index=True), notes, named)


def _notes_on_events(left_out: Mapping[str, Sequence[str]], empty: Sequence[Path]) -> list[str]:
    """Returns sentences on what is not shown: tags, by what is said of them, and empty files."""
    notes = []
    for note, names in left_out.items():
        files = names[0]
        if len(names) > 1:
            files = f"{len(names)} event files such as {names[0]}"
        notes.append(f"Of the tags in {files}, {note}.")

    if empty:
        first = f"{empty[0].resolve().parent.name}/{empty[0].name}"
        if len(empty) == 1:
            notes.append(f"{first} has no scalar and is left out.")
        else:
            files = f"{len(empty)} event files, such as {first},"
            notes.append(f"{files} have no scalar and are left out.")

    return notes


def _scalars(
    file: ImportedFile, events: Events, seed: int, returns: ReturnsName
) -> tuple[Series, str]:
    """Returns the returns in a file of TensorBoard, and what is said of other tags; "" of none."""
    scalars = events.scalars
    known = [*TAGS]
    if returns == "evaluation":
        known.insert(0, EVALUATION_TAG)

    tag = next((tag for tag in known if tag in scalars), None)
    if tag is None:
        its_tags = ", ".join(sorted(scalars)) or "none"
        raise RequestError(
            f"{file.path} has no tag {in_prose(known)}; write a CSV file of one of its tags: "
            f"{its_tags}."
        )

    points = pd.DataFrame(scalars[tag], columns=["control_steps", "wall_time", "episode_return"])
    if not np.isfinite(points["episode_return"]).all():
        raise RequestError(f"{file.path}: a value of {tag} is not a finite number.")

    others = [other for other in (EVALUATION_TAG, *TAGS) if other in scalars and other != tag]
    note = ""
    if others:
        note = f"{tag} is shown, not {in_prose(others)}"
    return Series(file, seed, returns, points, {"return": tag}, events.resumed_at), note


def _labelled(points: pd.DataFrame, names: PathNames) -> pd.DataFrame:
    """Returns points with the labels of their run."""
    return points.assign(task=names.task, method=names.method, seed=names.seed)
