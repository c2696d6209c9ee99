"""Learning curves of any environment in files of the forms in which people publish and log them."""

import re
from codecs import BOM_UTF8
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import BaseModel, Field, FiniteFloat, TypeAdapter, ValidationError

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.named_columns import read_named_columns
from jbench.importing.readers import read_evaluations, read_monitor
from jbench.importing.request import parse_seed
from jbench.names import ReturnsName
from jbench.wording import counted

_RUN = ["task", "method", "seed"]
_COLUMNS = [*_RUN, "steps", "return"]

_MOST = 1e15
"""Largest return; differences and sums of larger ones are no longer exact numbers."""

_RL_ZOO = re.compile(r"(.+)_(\d+)")
"""Folder of a run of RL Baselines3 Zoo: the environment, and the number of the run."""


class _Curve(BaseModel):
    """A curve in the JSON of HumanoidBench."""

    million_steps: list[FiniteFloat]
    returns: list[FiniteFloat] = Field(alias="return")


_JSON = '{task: {method: {"seed_0": {"million_steps": [...], "return": [...]}}}}'
_CURVES = TypeAdapter(dict[str, dict[str, dict[str, _Curve]]])


def read_curves(path: Path, returns: ReturnsName = "evaluation") -> tables.CurveFile:
    """Reads a file of curves, or all files in a folder.

    A file is CSV with a row for each point, whose columns have any of the usual names, the JSON of
    HumanoidBench, or an `evaluations.npz` or a Monitor's file of stable-baselines3. Of a folder
    that has files of stable-baselines3, those with the kind of returns are read.

    Raises:
        RequestError: if it can't be read, lacks a column, or has a value that is none.
    """
    parts = [_read(file) for file in map(tables.open_file, _files(path, returns))]
    points = pd.concat([part.points for part in parts], ignore_index=True)
    if "wall_time" in points:  # of the files of several environments of a run
        points = points.sort_values("wall_time", kind="stable", ignore_index=True)
        points["steps"] = points.groupby(_RUN)["length"].cumsum()
    points = points[_COLUMNS]
    notes = list(dict.fromkeys(note for part in parts for note in part.notes))
    return tables.CurveFile(_checked(points, path), notes)


def _files(path: Path, returns: ReturnsName) -> Sequence[Path]:
    """Returns the files of a folder that have curves, of the kind of return that is asked for."""
    if not path.is_dir():
        return [path]

    patterns = ["*.monitor.csv", "evaluations*.npz"]
    if returns == "evaluation":
        patterns.reverse()

    for pattern in patterns:
        if found := sorted(path.rglob(pattern)):
            return found

    if found := sorted([*path.rglob("*.csv"), *path.rglob("*.json")]):
        return found

    raise RequestError(f"{path} is a directory without a .csv, .json or .npz file; name a file.")


def _read(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads a file by its first bytes, whatever its name is."""
    start = file.content.removeprefix(BOM_UTF8).lstrip()
    if start.startswith(b"{"):
        return tables.CurveFile(_from_json(file), [])
    if start.startswith(b"#{"):
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
    check(is_count, "{steps:g} is no number of steps")
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
    points = points.assign(steps=points["control_steps"])
    means = points.groupby("point", as_index=False)[["steps", "episode_return"]].mean()
    means = means.rename(columns={"episode_return": "return"})
    bad = means[~np.isfinite(means[["steps", "return"]]).all(axis=1)]
    if len(bad):
        number = bad["point"].iloc[0] + 1
        raise RequestError(f"{file.path}, evaluation {number}: not a finite number.")

    names, notes = _names_in_path(file.path)
    return tables.CurveFile(means.assign(**names), notes)


def _from_monitor(file: tables.ImportedFile) -> tables.CurveFile:
    """Reads the training episodes of a run, of which a later part may have been appended."""
    monitor = read_monitor(file)
    names, notes = _names_in_path(file.path, monitor.env_id)
    if monitor.restarts:
        notes.append(
            f"The time goes back {counted(len(monitor.restarts), 'time')} in {file.path.name}: it "
            "is read as one training that was resumed."
        )

    points = monitor.points.rename(columns={"control_steps": "steps", "episode_return": "return"})
    return tables.CurveFile(points.assign(**names), notes)


def _names_in_path(path: Path, env_id: str = "") -> tuple[dict[str, Any], list[str]]:
    """Returns the labels of a run of stable-baselines3, which its file doesn't have, and a note."""
    folder = path.resolve().parent
    match = _RL_ZOO.fullmatch(folder.name)
    numbered = re.findall(r"seed[_-]?(\d+)", str(path), re.IGNORECASE)
    seed = numbered[-1] if numbered else (match[2] if match else "0")
    known = env_id if env_id not in ("", "None") else ""
    task = known or (match[1] if match else folder.name) or "task"
    method = folder.parent.name or "method"
    names: dict[str, Any] = {"task": task, "method": method}
    names["seed"] = parse_seed(seed, f"{path}: the seed is")
    return names, [
        f"{folder.name}/{path.name}: method {method}, task {task} and seed {seed} are those of its "
        "path."
    ]


def _from_json(file: tables.ImportedFile) -> pd.DataFrame:
    """Reads the JSON of HumanoidBench, which has the curves of all seeds."""
    try:
        curves = _CURVES.validate_json(file.content.removeprefix(BOM_UTF8))
    except ValidationError as error:
        first = error.errors(include_input=False)[0]
        where = "".join(f"{part!r:.42}: " for part in first["loc"])
        raise RequestError(
            f"{file.path} is no JSON file of curves, which is {_JSON}: {where}{first['msg']}."
        ) from None

    parts = []
    for task, methods in curves.items():
        for method, curves_by_seed in methods.items():
            for name, curve in curves_by_seed.items():
                where = f"{file.path}: {method[:40]!r} on {task[:40]!r}, {name[:40]!r}"
                seed = parse_seed(name.removeprefix("seed_"), f"{where}: the seed is")
                if not len(curve.million_steps) == len(curve.returns) > 0:
                    raise RequestError(
                        f"{where}: million_steps and return must be as many finite numbers."
                    )

                steps = (np.array(curve.million_steps) * 1e6).round()
                labels = {"task": task, "method": method, "seed": seed}
                parts.append(pd.DataFrame({**labels, "steps": steps, "return": curve.returns}))

    if not parts:
        raise RequestError(f"{file.path} has no curves; leave the file out.")

    return pd.concat(parts, ignore_index=True)
