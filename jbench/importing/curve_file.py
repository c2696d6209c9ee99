"""Learning curves of any environment in one file: CSV, or the JSON of HumanoidBench."""

import json
from codecs import BOM_UTF8
from pathlib import Path

import numpy as np
import pandas as pd

from jbench.errors import RequestError
from jbench.importing.csv_files import numbers, read_seeds, read_table
from jbench.importing.request import MAX_STEPS, ImportedFile, open_file, parse_seed
from jbench.names import ReturnsName

RUN = ["task", "method", "seed"]
COLUMNS = [*RUN, "steps", "return"]
_JSON = '{task: {method: {"seed_0": {"million_steps": [...], "return": [...]}}}}'


def read_curves(path: Path) -> pd.DataFrame:
    """Returns the points of a file, ordered by `COLUMNS`.

    Raises:
        RequestError: if it can't be read, lacks a column, or has a value that is none.
    """
    file = open_file(path)
    is_json = file.content.removeprefix(BOM_UTF8).lstrip().startswith(b"{")
    points = _from_json(file) if is_json else _from_csv(file)
    for name in ("task", "method"):
        for text in points[name].unique():
            if not (text.strip() and text.isprintable()):
                raise RequestError(f"{path}: {text[:40]!r} is no name of a {name}; rename it.")
    steps = points["steps"].to_numpy(np.float64)
    bad = (steps < 0) | (steps % 1 != 0) | (steps > MAX_STEPS)
    if bad.any():
        raise _refused(file, points[bad], f"{steps[bad][0]:g} is no number of steps")
    points = points.astype({"steps": np.int64}).sort_values(COLUMNS, ignore_index=True)
    doubled = points.duplicated(COLUMNS[:-1])
    if doubled.any():
        at = points["steps"][doubled].iloc[0]
        raise _refused(file, points[doubled], f"two returns at {at:,} steps; remove one of them")
    return points[COLUMNS]


def as_imports(points: pd.DataFrame, returns: ReturnsName) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns curves as rows of `imports` and `import_points`, with the method as algorithm."""
    curves = points.groupby(RUN, sort=False)
    named = {"control_steps": points["steps"], "episode_return": points["return"]}
    numbered = points.assign(point=curves.cumcount(), episode=0, **named)
    numbered["import"] = "curve " + (curves.ngroup() + 1).astype(str)
    imports = numbered.groupby(RUN, sort=False).last().reset_index()
    texts = {"representation": "", "status": "finished", "format": "csv", "provenance": "{}"}
    algo, count = imports["method"], imports["point"] + 1
    return imports.assign(algo=algo, returns=returns, points=count, **texts), numbered


def to_json(points: pd.DataFrame) -> str:
    """Returns points, see `read_curves`, as the JSON of HumanoidBench."""
    tasks: dict[str, dict[str, dict[str, dict[str, list[float]]]]] = {}
    for key, curve in points.groupby(RUN, sort=False):
        task, method, seed = map(str, key)
        tasks.setdefault(task, {}).setdefault(method, {})[f"seed_{seed}"] = {
            "million_steps": (curve["steps"] / 1e6).tolist(),
            "return": curve["return"].tolist(),
        }
    return json.dumps(tasks, allow_nan=False) + "\n"


def _from_csv(file: ImportedFile) -> pd.DataFrame:
    # Spreadsheets end the last line without a line break.
    table = read_table(file, ends_line=False)
    for name in COLUMNS:
        if name not in table:
            raise RequestError(
                f"{file.path} has no column {name!r}; it needs the columns method, task, seed, "
                "steps and return."
            )
    values = {name: numbers(table, name, file) for name in ("steps", "return")}
    return table[["task", "method"]].assign(seed=read_seeds(table, "seed", file), **values)


def _from_json(file: ImportedFile) -> pd.DataFrame:
    try:
        tasks = json.loads(file.content)
        curves = [
            (task, method, name, curve)
            for task, methods in tasks.items()
            for method, seeds in methods.items()
            for name, curve in seeds.items()
        ]
        return pd.concat([_json_curve(file, *curve) for curve in curves], ignore_index=True)
    except RequestError:
        raise
    except (ValueError, AttributeError, RecursionError):
        raise RequestError(f"{file.path} is no JSON file of curves, which is {_JSON}.") from None


def _json_curve(
    file: ImportedFile, task: str, method: str, name: str, curve: dict[str, list[float]]
) -> pd.DataFrame:
    where = f"{file.path}: {method[:40]!r} on {task[:40]!r}, {name[:40]!r}"
    seed = parse_seed(name.removeprefix("seed_"), f"{where}: the seed is")
    try:
        steps, returns = (np.array(curve[key], np.float64) for key in ("million_steps", "return"))
        points = pd.DataFrame({"steps": (steps * 1e6).round(), "return": returns})
    except (KeyError, TypeError, ValueError, OverflowError):
        points = pd.DataFrame()
    if points.empty or not np.isfinite(points).all(axis=None):
        raise RequestError(f"{where}: million_steps and return must be as many finite numbers.")
    return points.assign(task=task, method=method, seed=seed)


def _refused(file: ImportedFile, points: pd.DataFrame, reason: str) -> RequestError:
    task, method, seed = points[RUN].iloc[0]
    return RequestError(f"{file.path}: {method[:40]!r} on {task[:40]!r}, seed {seed}: {reason}.")
