"""What the page shows of a run that is opened: facts, settings, curves and paths."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.data.configuration import OWN
from jbench.report.data.returns import FILE, clean
from jbench.report.frames import Frames
from jbench.statistics import FloatArray

_RUN_POINTS, _PATH_POINTS = 50, 20
_PAGE_POINTS = 6_000  # of the curves of all runs together


def run_details(frames: Frames) -> dict[str, Any]:
    """Returns the runs for the script: names, facts, settings by number, curves and paths."""
    settings: dict[tuple[str, str], int] = {}
    curves: dict[Any, list[tuple[str, FloatArray]]] = {}
    for (source, run, kind), rows in _points(frames.run_curves, ["source", "run", "returns"]):
        curves.setdefault((source, run), []).append((f"{kind} return", rows))
    for pairs in curves.values():  # the leading one first, if it has five points or more
        pairs.sort(key=lambda pair: (len(pair[1]) < 5, pair[0] != f"{frames.returns} return"))
    for (run, name), rows in _points(frames.metrics, ["run", "name"]):
        curves.setdefault((OWN, run), []).append((str(name), rows))
    paths = {
        key: list(_paths(rows)) for key, rows in frames.paths.groupby(["source", "run"], sort=False)
    }
    most = max(2, min(_RUN_POINTS, _PAGE_POINTS // max(1, sum(map(len, curves.values())))))
    runs = []
    for row in frames.runs.to_dict("records"):
        key, source = (row["source"], row["run"]), row["source"]
        texts = [(clean(str(n)), clean(str(v))) for n, v in row["settings"].items()]
        facts = [row["label"], f"seed {row['seed']}", row["status"], row["diverged"], row["day"]]
        runs.append(
            {
                "name": row["run"] if source in (OWN, FILE) else f"{source}: {row['run']}",
                "facts": ", ".join(filter(None, facts)),
                "settings": [settings.setdefault(pair, len(settings)) for pair in texts],
                "curves": [_thin_curve(*pair, most) for pair in curves.get(key, [])],
                "paths": paths.get(key, []),
            }
        )
    return {"settings": list(settings), "runs": runs}


def _points(rows: pd.DataFrame, by: list[str]) -> Iterator[tuple[Any, FloatArray]]:
    """Yields the names of each curve and its points, (points, 2): control steps and values."""
    for names, points in rows.groupby(by, sort=False)[["steps", "value"]]:
        yield names, points.to_numpy(float)


def _thin_curve(name: str, points: FloatArray, most: int) -> list[Any]:
    """Returns name, steps and values of a run's curve, thinned to at most `most` points."""
    shown = np.linspace(0, len(points) - 1, min(len(points), most)).round().astype(int)
    steps, values = points[shown].T
    texts = [json.loads(f"{value:.3g}") for value in values]
    return [name, steps.round().astype(int).tolist(), texts]


def _paths(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yields the first and the last path of a run, in tenths of a millimeter."""
    steps = sorted(rows["steps"].unique())
    for at in dict.fromkeys((steps[0], steps[-1])):
        path = rows[rows["steps"] == at]
        last = path.iloc[-1]
        path = path.iloc[np.linspace(0, len(path) - 1, min(len(path), _PATH_POINTS)).astype(int)]
        numbers = {"heading": last["heading"], "gained": last["episode_return"]}
        numbers |= {name: last[f"target_{name}"] for name in ("x", "y", "yaw")}
        known = {n: round(float(v), 3) for n, v in numbers.items() if np.isfinite(v)}
        points = (path[["x", "y"]].to_numpy(np.float64) * 1e4).round().astype(int)
        yield {**known, "steps": int(at), "points": points.ravel().tolist()}
