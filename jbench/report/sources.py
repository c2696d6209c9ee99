"""Whose runs a report is of: those of the results, the shipped ones, two sides of a comparison."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.errors import RequestError, WorkError
from jbench.report.data.building import build_cells, usable_runs
from jbench.report.data.cells import OURS, Cell
from jbench.report.data.variants import value_text
from jbench.report.request import Request
from jbench.settings.alike import flatten
from jbench.settings.run import Run, read_run
from jbench.store import Results, query

REFERENCE = "reference"
"""What the cells of the shipped runs are called."""

Choice = Callable[[Run], bool]
"""Says of a run's settings whether it is chosen."""

_RUNS = ("runs", "episodes", "evaluations")
_MORE = (
    *("encoders", "encoder_errors", "encoder_predictions"),
    *("policy_evaluations", "policy_episodes"),
)
_POINT = ("control_steps", "episode_return", "processor_time")
_COLUMNS = {"episodes": ("run", "episode", *_POINT), "evaluations": ("run", "evaluation", *_POINT)}
_READ: dict[str, Any] = {"coded": True, "columns": _COLUMNS}


class NothingYetError(RequestError):
    """There is nothing to report, which may change while runs go on."""


@dataclass(frozen=True)
class Source:
    """Runs from one place.

    Attributes:
        cells: of the runs, of both kinds of return.
        runs: rows of the table `runs`, of those that are in a cell or could be.
        notes: sentences on runs that are in no cell.
        problems: a sentence for each record that can't be read.
        tables: of encoders and policies; only of the results themselves.
        name: of the source in its cells.
    """

    cells: list[Cell]
    runs: pd.DataFrame
    notes: list[str]
    problems: list[str]
    tables: dict[str, pa.Table]
    name: str = OURS


def own(results: Results, request: Request) -> Source:
    """Returns the runs of the results, as far as the request lets them through."""
    tables, problems = query.load(results, (*_RUNS, *_MORE), **_READ)
    return _source(tables, problems, request)


def reference(request: Request, place: Path) -> Source:
    """Returns the runs that are shipped with jbench, as cells of their own."""
    if not place.is_dir():
        return Source([], pd.DataFrame(), [_NO_REFERENCE], [], {}, REFERENCE)
    tables, problems = query.load(Results(place), _RUNS, **_READ)
    found = _source(tables, problems, request, REFERENCE, strict=False)
    notes = found.notes if found.cells else [*found.notes, _NO_REFERENCE]
    return Source(found.cells, found.runs, notes, found.problems, {}, REFERENCE)


_NO_REFERENCE = "This version of jbench ships no reference runs of what is reported."


def side(text: str, results: Results, request: Request) -> Source:
    """Returns the runs of one side of a comparison, as cells of that name.

    Args:
        text: a results directory, or settings that choose runs of the results: `engine=batched`,
            `algo=td3,representation=dae12`.
        results: to choose from.
        request: whose filters hold, too.

    Raises:
        RequestError: if it is neither, or no run is chosen.
    """
    if Path(text).is_dir():
        tables, problems = query.load(Results(Path(text)), _RUNS, **_READ)
        found = _source(tables, problems, request, text)
    else:
        tables, problems = query.load(results, _RUNS, **_READ)
        settings = [read_run(json.loads(one)) for one in tables["runs"]["settings"].to_pylist()]
        choice = _choice(text, settings)
        found = _source(tables, problems, request, text, choice)
    if not found.cells:
        problems_told = " ".join(found.problems)
        raise NothingYetError(f"There is no run with an episode of {text}. {problems_told}".strip())
    return found


def names_of(text: str) -> tuple[str, ...]:
    """Returns the settings that a side of a comparison chooses by; a directory has none."""
    if Path(text).is_dir():
        return ()
    return tuple(part.partition("=")[0].strip() for part in text.split(","))


def nothing_to_report(results: Results, problems: Sequence[str]) -> RequestError | WorkError:
    """Returns the error for results without a run that can be reported."""
    records, unreadable = results.scan("run")
    if records or unreadable:
        return WorkError(
            f"No run in {results.path} can be reported. {' '.join(problems)} `jbench verify` says "
            "what is damaged, `jbench repair` sets it aside."
        )
    return NothingYetError(
        f"There are no runs in {results.path}; run "
        "`jbench train --task face_direction --steps 100000 --seeds 0-1` first."
    )


def _source(
    tables: dict[str, pa.Table],
    problems: list[str],
    request: Request,
    name: str = OURS,
    choice: Choice | None = None,
    *,
    strict: bool = True,
) -> Source:
    runs, unusable = usable_runs(tables["runs"])
    if choice is not None:
        runs = runs[np.array([choice(read_run(json.loads(one))) for one in runs["settings"]], bool)]
    runs, early = _begun_since(runs, request)
    runs = _filter(runs, request.task, request.algo, strict=strict) if len(runs) else runs
    points = tables.pop("episodes"), tables.pop("evaluations")
    cells, notes = build_cells(runs, *points, name) if len(runs) else ([], [])
    return Source(cells, runs, early + notes, [*problems, *unusable], tables, name)


def _begun_since(runs: pd.DataFrame, request: Request) -> tuple[pd.DataFrame, list[str]]:
    since = request.begun_since()
    if since is None:
        return runs, []
    begun = pd.to_datetime(runs["created"], utc=True, errors="coerce", format="ISO8601") >= since
    left = int((~begun).sum())
    told = [f"{left} runs were begun before {request.since} and are left out."] if left else []
    if left and left == len(runs):
        raise NothingYetError(f"No run was begun since {request.since}; {told[0]}")
    return runs[begun], told


def _filter(
    runs: pd.DataFrame, task: str | None, algo: str | None, *, strict: bool
) -> pd.DataFrame:
    """Returns the runs asked for; there is at least one if that is wanted strictly."""
    wanted = pd.Series(True, index=runs.index)
    for name, value in (("task", task), ("algo", algo)):
        if value is not None:
            wanted &= runs[name] == value
    if strict and not wanted.any():
        there = "; ".join(
            f"{name} with {', '.join(sorted(set(group)))}"
            for name, group in runs.groupby("task")["algo"]
        )
        asked = " and ".join(
            f"{name} {value!r}"
            for name, value in (("task", task), ("algo", algo))
            if value is not None
        )
        raise NothingYetError(f"There are no runs of {asked}; there are runs of {there}.")
    return runs[wanted]


def _choice(text: str, settings: Sequence[Run]) -> Choice:
    """Returns what chooses runs by the settings that were typed.

    Raises:
        RequestError: if no settings were typed, or none of the runs has them.
    """
    wanted = []
    for part in text.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not (name and equals):
            raise RequestError(
                f"--compare {text}: there is no such directory; type two results directories, or "
                "settings such as engine=sb3 engine=batched."
            )
        there = {value_text(found) for run in settings for found in _values(run, name)}
        if not there:
            names = sorted({".".join(path) for run in settings for path in flatten(run)})
            raise RequestError(f"No run has a setting {name!r}; there are {', '.join(names)}.")
        if not any(_equal(value, one) for one in there):
            raise RequestError(f"No run has {part.strip()}; there are {', '.join(sorted(there))}.")
        wanted.append((name, value))
    return lambda run: all(
        any(_equal(value, value_text(one)) for one in _values(run, name)) for name, value in wanted
    )


def _values(settings: Run, name: str) -> list[Any]:
    """Returns the values of a setting that is named whole, or by its last part."""
    flat = flatten(settings)
    return [value for path, value in flat.items() if name in (path[-1], ".".join(path))]


def _equal(typed: str, said: str) -> bool:
    """Returns whether what was typed is a value: 1e-4 is 0.0001."""
    try:
        return math.isclose(float(typed), float(said), rel_tol=1e-5)
    except ValueError:
        return typed.replace(" ", "") == said.replace(" ", "")
