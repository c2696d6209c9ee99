"""What the page shows of a run that a reader opens: its settings, origin, curves and paths.

Runs share most of their settings and control steps. These are written once, and a run has their
places in the lists of all.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import pandas as pd

from jbench.array_types import FloatArray
from jbench.report.data.source_names import OWN
from jbench.report.frames import Frames
from jbench.report.texts import clean

_RUN_POINTS = 50
_PATH_POINTS = 20

_PAGE_POINTS = 6_000
"""Number of points of the curves of all runs together."""

_FEW_POINTS = 5
"""A curve with fewer points comes after the others."""

_ORIGIN = {"git revision": "commit", "processor": "processor", "command": "command"}
"""What the page shows of a run's provenance, and what it calls it."""

_PATH = ["steps", "x", "y", "heading", "target_x", "target_y", "target_yaw"]
"""Columns of the points of paths, without the names of runs."""

_PLACE = slice(1, 3)
"""Where x and y are among them."""

_Key = tuple[str, str]  # source and id of a run
_Value = TypeVar("_Value")


class RunCurve(NamedTuple):
    """A curve of a run; `steps` is the place of its control steps."""

    name: str
    steps: int
    values: list[float]


@dataclass(frozen=True)
class RunDetail:
    """What the page shows of one run beside its row.

    Attributes:
        diverged: when, in words; empty if it did not diverge.
        settings: places of its settings.
        origin: places of its commit, processor and command.
        curves: of the leading kind of return first.
        paths: of its first and its last evaluation; see `_paths`.
    """

    diverged: str
    settings: list[int]
    origin: list[int]
    curves: list[RunCurve]
    paths: list[dict[str, Any]]


@dataclass(frozen=True)
class RunDetails:
    """What the page shows of runs beside their rows.

    Attributes:
        settings: names and values.
        steps: control steps of curves.
        origins: texts.
        runs: in the order of `Frames.runs`.
    """

    settings: list[tuple[str, str]]
    steps: list[tuple[int, ...]]
    origins: list[str]
    runs: list[RunDetail]


class _Places(Generic[_Value]):
    """Different values in the order in which they were first asked for."""

    def __init__(self) -> None:
        self._places: dict[_Value, int] = {}

    def of(self, value: _Value) -> int:
        """Returns the place of a value, a new one if it has none."""
        return self._places.setdefault(value, len(self._places))

    def values(self) -> list[_Value]:
        """Returns the values by place."""
        return list(self._places)


def run_details(frames: Frames) -> RunDetails:
    """Returns what the page shows of runs beside their rows."""
    settings = _Places[tuple[str, str]]()
    steps = _Places[tuple[int, ...]]()
    origins = _Places[str]()
    curves = _curves(frames, steps)
    columns = frames.paths[_PATH].to_numpy(np.float64)
    by_run = frames.paths.groupby(["source", "run"], sort=False).indices
    paths = {key: list(_paths(columns[places])) for key, places in by_run.items()}

    details = []
    for row in frames.runs.to_dict("records"):
        key = row["source"], row["run"]
        recorded = row["provenance"]
        origin = [
            f"{name}: {clean(recorded[of])}" for of, name in _ORIGIN.items() if of in recorded
        ]
        texts = [(clean(str(name)), clean(str(value))) for name, value in row["settings"].items()]
        detail = RunDetail(
            diverged=row["diverged"],
            settings=[settings.of(text) for text in texts],
            origin=[origins.of(text) for text in origin],
            curves=curves.get(key, []),
            paths=paths.get(key, []),
        )
        details.append(detail)

    return RunDetails(settings.values(), steps.values(), origins.values(), details)


def _curves(frames: Frames, steps: _Places[tuple[int, ...]]) -> dict[_Key, list[RunCurve]]:
    """Returns the curves of each run: its returns, then the numbers that it logged."""
    returns = frames.run_curves
    sizes = returns.groupby(["source", "run", "returns"])["steps"].transform("size")
    returns = returns.assign(few=sizes < _FEW_POINTS, other=returns["returns"] != frames.returns)
    returns = returns.sort_values(["few", "other"], kind="stable")
    returns = returns.assign(name=returns["returns"] + " return")

    logged = frames.metrics
    logged = logged[np.isfinite(logged["value"]) & logged["run"].isin(frames.runs["run"])]
    logged = logged.rename(columns={"control_steps": "steps"}).assign(source=OWN)

    groups = pd.concat([returns, logged]).groupby(["source", "run", "name"], sort=False)
    most = max(2, min(_RUN_POINTS, _PAGE_POINTS // max(1, groups.ngroups)))
    curves: dict[_Key, list[RunCurve]] = {}
    for (source, run, name), points in groups[["steps", "value"]]:
        at = np.linspace(0, len(points) - 1, min(len(points), most)).round().astype(int)
        shown = points.to_numpy(float)[at]
        values = [json.loads(f"{value:.3g}") for value in shown[:, 1]]
        place = steps.of(tuple(shown[:, 0].round().astype(int).tolist()))
        curves.setdefault((source, run), []).append(RunCurve(str(name), place, values))

    return curves


def _paths(rows: FloatArray) -> Iterator[dict[str, Any]]:
    """Yields the first and the last path of a run, without points at which the robot waits.

    A path has its `points` in tenths of a millimeter (x, y, x, y, ...), the last `heading` (rad),
    and, if they are known, x and y (m) and yaw (rad) of the target.

    Args:
        rows: (points, columns) of the run, with the columns `_PATH`.
    """
    steps = rows[:, 0]
    for at in dict.fromkeys((steps.min(), steps.max())):
        path = rows[steps == at]
        last = dict(zip(_PATH, path[-1].tolist(), strict=True))
        path = path[np.linspace(0, len(path) - 1, min(len(path), _PATH_POINTS)).astype(int)]
        numbers = {
            "x": last["target_x"],
            "y": last["target_y"],
            "yaw": last["target_yaw"],
            "heading": last["heading"],
        }
        known = {name: round(value, 3) for name, value in numbers.items() if np.isfinite(value)}
        points = (path[:, _PLACE] * 1e4).round().astype(int)
        moved = np.append(True, (points[1:] != points[:-1]).any(axis=1))
        yield {**known, "points": points[moved].ravel().tolist()}
