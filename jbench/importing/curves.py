"""Learning curves in the form of runs: imported ones, and those of any environment in one file."""

import json
from codecs import BOM_UTF8
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import BaseModel, Field, FiniteFloat, TypeAdapter, ValidationError

from jbench.errors import RequestError
from jbench.importing import tables
from jbench.importing.request import parse_seed
from jbench.names import ReturnsName, in_prose
from jbench.settings.recorded import variant
from jbench.store import schema
from jbench.store.listed import to_table
from jbench.wording import are, counted

_LABELS = ["task", "algo", "representation"]
_SEED = [*_LABELS, "seed"]
_RETURNS = {"episodes": "training", "evaluations": "evaluation"}
_EPISODES = ("sb3-monitor", "sb3-evaluations")
"""Formats whose points are episodes or evaluations; points of other formats are logged values."""

_PROVENANCE = ("jbench", "python", "git_revision", "command")
"""What is kept of an import's provenance; its machine is not that of the training."""

_RUN = ["task", "method", "seed"]
_COLUMNS = [*_RUN, "steps", "return"]


class _Curve(BaseModel):
    """A curve in the JSON of HumanoidBench."""

    million_steps: list[FiniteFloat]
    returns: list[FiniteFloat] = Field(alias="return")


_JSON = '{task: {method: {"seed_0": {"million_steps": [...], "return": [...]}}}}'
_CURVES = TypeAdapter(dict[str, dict[str, dict[str, _Curve]]])


def as_runs(
    imports: pd.DataFrame, points: pd.DataFrame
) -> tuple[dict[str, pa.Table], list[str], list[str]]:
    """Returns tables of runs from the rows of `imports` and `import_points`; notes and problems.

    The training and the evaluation returns of a seed become one run. Of several curves of the same
    kind, the longest is used.
    """
    frame = imports[imports["status"] == "finished"]
    # A manifest that jbench has not written may lack any of these.
    incomplete = frame[[*_SEED, "returns", "points", "control_steps"]].isna().any(axis=1)
    problems = [
        f"The import {id} lacks a label, a seed, its kind of return or its length; it is not "
        "reported."
        for id in frame.loc[incomplete, "import"]
    ]
    frame = frame[~incomplete].astype({"seed": np.int64})
    # Training returns first, and the longest curve first.
    frame = frame.sort_values(
        ["returns", "control_steps", "points", "import"], ascending=[False, False, False, True]
    )
    frame["run"] = frame.groupby(_SEED)["import"].transform("first")
    chosen = frame.drop_duplicates([*_SEED, "returns"])
    named = points.merge(chosen[["import", "run", "returns"]], on="import")
    named = named.assign(evaluation=named["point"], processor_time=np.nan)
    named.loc[named["returns"] == "training", "episode"] = named["point"]
    runs = chosen.drop_duplicates("run")
    # The settings that jbench knows are the labels and the seed.
    known: list[Any] = runs[_SEED].astype(dict.fromkeys(_LABELS, str)).to_dict("records")
    recorded = map(json.loads, runs["provenance"])
    kept = [{name: made[name] for name in _PROVENANCE if name in made} for made in recorded]
    texts = {"settings": list(map(json.dumps, known)), "provenance": list(map(json.dumps, kept))}
    runs = runs.assign(variant=list(map(variant, known)), **texts)
    rows = {"runs": to_table(runs, schema.TABLES["runs"])}
    for name, kind in _RETURNS.items():
        rows[name] = to_table(named[named["returns"] == kind], schema.TABLES[name])
    return rows, _notes(frame, chosen), problems


def _notes(frame: pd.DataFrame, chosen: pd.DataFrame) -> list[str]:
    if frame.empty:
        return []
    formats = sorted(set(chosen["format"]))
    notes = [
        f"{counted(len(chosen), 'imported curve')} ({', '.join(formats)}) {are(len(chosen))} not "
        "verified: jbench has not run the agents. Imported curves are in no claim."
    ]
    if logged := [name for name in formats if name not in _EPISODES]:
        notes.append(
            f"A point of an imported {in_prose(logged)} curve is a value in its file, which need "
            "not be the return of a single episode."
        )
    if shorter := len(frame) - len(chosen):
        notes.append(
            f"{counted(shorter, 'imported curve')} {are(shorter)} not used, since a longer one of "
            "the same seed was imported."
        )
    return notes


def read_curves(path: Path) -> pd.DataFrame:
    """Returns the points of a file: task, method, seed, steps and return, in this order.

    The file is CSV, or the JSON of HumanoidBench.

    Raises:
        RequestError: if it can't be read, lacks a column, or has a value that is none.
    """
    file = tables.open_file(path)
    if file.content.removeprefix(BOM_UTF8).lstrip().startswith(b"{"):
        points = _from_json(file)
    else:
        # Spreadsheets end the last line without a line break.
        table = tables.read_table(file, ends_line=False)
        for name in _COLUMNS:
            tables.check_column(table, name, file, f"it needs {', '.join(_COLUMNS)}, but has")
        points = tables.numbers(table, {name: name for name in ("steps", "return")}, file)
        points[["task", "method"]] = table[["task", "method"]]
        points["seed"] = tables.seeds(table, "seed", file)
    points = points[_COLUMNS]

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
    points = points.astype({"steps": np.int64}).sort_values(_COLUMNS, ignore_index=True)
    doubled = points.duplicated(_COLUMNS[:-1])
    check(~doubled, "two returns at {steps:,} steps; remove one of them")
    return points


def _from_json(file: tables.ImportedFile) -> pd.DataFrame:
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


def as_imports(points: pd.DataFrame, returns: ReturnsName) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns curves as rows of `imports` and `import_points`, with the method as algorithm."""
    curves = points.groupby(_RUN, sort=False)
    named = {"control_steps": points["steps"], "episode_return": points["return"]}
    numbered = points.assign(point=curves.cumcount(), episode=0, **named)
    numbered["import"] = "curve " + (curves.ngroup() + 1).astype(str)
    imports = numbered.groupby(_RUN, sort=False).last().reset_index()
    texts = {"representation": "", "status": "finished", "format": "csv", "provenance": "{}"}
    algo, count = imports["method"], imports["point"] + 1
    return imports.assign(algo=algo, returns=returns, points=count, **texts), numbered


def to_json(points: pd.DataFrame) -> str:
    """Returns points, see `read_curves`, as the JSON of HumanoidBench."""
    tasks: dict[str, dict[str, dict[str, dict[str, list[float]]]]] = {}
    for key, curve in points.groupby(_RUN, sort=False):
        task, method, seed = map(str, key)
        tasks.setdefault(task, {}).setdefault(method, {})[f"seed_{seed}"] = {
            "million_steps": (curve["steps"] / 1e6).tolist(),
            "return": curve["return"].tolist(),
        }
    return json.dumps(tasks, allow_nan=False) + "\n"
