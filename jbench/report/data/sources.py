"""Sources of a report: the results, imports, the shipped runs, or two sides of a comparison."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbench.errors import NothingYetError, RequestError
from jbench.importing.curve_file import as_imports, read_curves
from jbench.importing.runs import as_runs
from jbench.names import REFERENCE
from jbench.report.data.build import build, usable_runs
from jbench.report.data.configuration import (
    IMPORTED,
    OWN,
    Configuration,
    paper_order,
    shown_representation,
)
from jbench.report.data.points import PATHS, POINT, run_paths, with_more_episodes
from jbench.report.data.returns import FILE
from jbench.report.request import Request, setting
from jbench.settings.alike import flatten
from jbench.settings.recorded import Run, parse_run
from jbench.settings.variants import value_text
from jbench.store import Results, query
from jbench.wording import are, counted

_RUNS = ("runs", "episodes", "evaluations", "paths")
_MORE = (
    *("encoders", "encoder_errors", "encoder_predictions"),
    *("policy_evaluations", "policy_episodes", "metrics"),
)
_COLUMNS = {
    "episodes": ("run", "episode", *POINT),
    "evaluations": ("run", "evaluation", "episode", *POINT),
    "paths": PATHS,
}


@dataclass(frozen=True)
class Source:
    """The runs of one results directory, of a selection of them, or of several.

    Attributes:
        configurations: for both kinds of return.
        runs: rows of the table `runs`, with a column `source`.
        notes: sentences on runs that are in no configuration.
        problems: a sentence for each unreadable record.
        tables: of encoders, policies and metrics; other sources than the results have none of them.
        paths: points of the robots' paths in evaluations; see `run_paths`.
    """

    configurations: list[Configuration]
    runs: pd.DataFrame
    notes: list[str]
    problems: list[str]
    tables: dict[str, pa.Table]
    paths: pd.DataFrame


def joined(parts: Sequence[Source]) -> Source:
    """Returns several sources as one, with the tables of the first."""
    return Source(
        sorted((one for part in parts for one in part.configurations), key=paper_order),
        pd.concat([part.runs for part in parts], ignore_index=True),
        [note for part in parts for note in part.notes],
        [problem for part in parts for problem in part.problems],
        parts[0].tables,
        pd.concat([part.paths for part in parts], ignore_index=True),
    )


def own(results: Results, request: Request, name: str = OWN, *, strict: bool = True) -> Source:
    """Returns the runs of the results that pass the filters of the request.

    Args:
        name: of the source.
        strict: whether it is an error if no run passes the filters.
    """
    return _source(_load(results, _MORE), request, name, strict=strict)


def imported(results: Results, request: Request, name: str = IMPORTED) -> Source:
    """Returns the imported curves of the requested task and algorithm.

    They have no date of a beginning.
    """
    tables, problems = query.load(results, ("imports", "import_points"))
    imports = tables["imports"]
    for label, value in (("task", request.task), ("algo", request.algo)):
        if value is not None:
            imports = imports.filter(pc.equal(imports[label], value))
    runs = as_runs(imports, tables["import_points"])
    read = query.Tables(runs.tables, problems + runs.problems)
    found = _source(read, replace(request, since=None), name, strict=False)
    return replace(found, notes=found.notes + (runs.notes if found.configurations else []))


def from_file(request: Request, path: Path) -> Source:
    """Returns the curves of a file of the requested task and algorithm.

    Raises:
        RequestError: if the file is no file of curves, or none passes the filters.
    """
    tables = as_imports(read_curves(path), request.returns)
    runs = as_runs(tables["imports"], tables["import_points"])
    return _source(query.Tables(runs.tables, runs.problems), request, FILE)


def own_and_imported(results: Results, request: Request) -> list[Source]:
    """Returns the runs of the results, and the imported curves if there are any.

    Raises:
        NothingYetError: if no run or import passes the filters of the request.
    """
    imports = imported(results, request)
    ours = own(results, request, strict=not imports.configurations)
    return [ours, imports] if imports.configurations or imports.problems else [ours]


def check_baseline(baseline: str, configurations: Sequence[Configuration]) -> None:
    """Checks that curves of the baseline were imported, and that there are others.

    Raises:
        NothingYetError: if none was imported, or there are no others.
    """
    labels = sorted({one.algo for one in configurations if one.source == IMPORTED})
    if baseline not in labels:
        instead = f"one of {', '.join(labels)}" if labels else "jbench import to import some"
        reason = f"no curve of that label was imported; type {instead}."
    elif all((one.source, one.algo) == (IMPORTED, baseline) for one in configurations):
        reason = "there are no other curves to draw it beside; leave it out."
    else:
        return
    raise NothingYetError(f"--baseline {baseline}: {reason}")


def reference(request: Request, results: Results) -> Source:
    """Returns the runs shipped with jbench, which form separate configurations."""
    filters = replace(request, since=None)  # the date selects runs of the user only
    found = _source(_load(results), filters, REFERENCE, strict=False)
    note = "This version of jbench ships no reference runs for this report."
    return found if found.configurations else replace(found, notes=[*found.notes, note])


def side(text: str, results: Results, request: Request) -> Source:
    """Returns the runs of one side of a comparison, as configurations of that name.

    Args:
        text: a results directory, or settings that select runs of the results, such as
            `engine=batched` or `algo=td3,representation=dae12`.
        request: its filters apply as well.

    Raises:
        RequestError: if the text is neither, or selects no run.
    """
    choice = None
    if Path(text).is_dir():
        read = _load(Results(Path(text)))
    else:
        read = _load(results)
        choice = _choice(
            text, [parse_run(one) for one in read.tables["runs"]["settings"].to_pylist()]
        )
    found = _source(read, request, text, choice)
    if not found.configurations:
        reasons = " ".join(found.problems)
        raise NothingYetError(f"There is no run with an episode of {text}. {reasons}".strip())
    return found


def _load(results: Results, more: Sequence[str] = ()) -> query.Tables:
    """Reads the tables of runs and those of these names."""
    return query.load(results, (*_RUNS, *more), coded=True, columns=_COLUMNS)


def _source(
    read: query.Tables,
    request: Request,
    name: str,
    choice: Callable[[Run], bool] | None = None,
    *,
    strict: bool = True,
) -> Source:
    """Returns the runs that pass the filters of the request and are chosen by their settings."""
    # The name of a directory may contain bytes that no table can hold.
    name = name.encode(errors="backslashreplace").decode()
    tables = read.tables
    runs, unusable = usable_runs(tables["runs"])
    if choice is not None:
        runs = runs[np.array([choice(parse_run(one)) for one in runs["settings"]], bool)]
    runs, early = _begun_since(runs, request, strict=strict)
    runs = _filter(runs, request, strict=strict) if len(runs) else runs
    points = tables.pop("episodes"), with_more_episodes(tables)
    tables.pop("evaluations")
    # Imported curves have no paths.
    paths = run_paths(tables.pop("paths", None), points[1]).assign(source=name)
    built, notes = build(runs, *points, name) if len(runs) else ([], [])
    problems = [*read.problems, *unusable]
    return Source(built, runs.assign(source=name), early + notes, problems, tables, paths)


def _begun_since(
    runs: pd.DataFrame, request: Request, *, strict: bool
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the runs begun since the requested time, and a note on the others.

    Raises:
        NothingYetError: if all runs were begun earlier, and `strict` is set.
    """
    since = request.begun_since()
    if since is None:
        return runs, []
    begun = pd.to_datetime(runs["created"], utc=True, errors="coerce", format="ISO8601") >= since
    earlier = int((~begun).sum())
    if not earlier:
        return runs, []
    note = f"{counted(earlier, 'run')} begun before {request.since} {are(earlier)} left out."
    if strict and earlier == len(runs):
        raise NothingYetError(f"No run was begun since {request.since}. {note}")
    return runs[begun], [note]


def _filter(runs: pd.DataFrame, request: Request, *, strict: bool) -> pd.DataFrame:
    """Returns the runs of the requested task and algorithm.

    Raises:
        NothingYetError: if there are none, and `strict` is set.
    """
    typed = {"task": request.task, "algo": request.algo}
    wanted = {name: value for name, value in typed.items() if value is not None}
    matches = (runs[[*wanted]] == pd.Series(wanted, dtype=object)).all(axis=1)
    if strict and not matches.any():
        existing = "; ".join(
            f"{name} with {', '.join(sorted(set(group)))}"
            for name, group in runs.groupby("task")["algo"]
        )
        asked = " and ".join(f"{name} {value!r}" for name, value in wanted.items())
        raise NothingYetError(f"There are no runs of {asked}; there are runs of {existing}.")
    return runs[matches]


def _choice(text: str, runs: Collection[Run]) -> Callable[[Run], bool]:
    """Returns a function that selects runs by the typed settings.

    Raises:
        RequestError: if the text contains no settings, or no run has them.
    """
    typed = []
    for part in map(str.strip, text.split(",")):
        name, value = setting(part)
        if not name or "=" not in part:
            named = {
                path[-1] for run in runs for path, one in flatten(run).items()
                if value_text(one) == part
            }  # fmt: skip
            example = f"{min(named)}={part}" if named else "engine=sb3 engine=batched"
            raise RequestError(
                f"--compare {text}: there is no such directory; type two results directories, or "
                f"settings such as {example}."
            )
        existing = {value_text(one) for run in runs for one in _values(run, name)}
        if not existing:
            names = sorted({".".join(path) for run in runs for path in flatten(run)})
            raise RequestError(f"No run has a setting {name!r}; there are {', '.join(names)}.")
        if not any(_equal(value, one) for one in existing):
            known = ", ".join(sorted(existing))
            raise RequestError(f"No run has {part}; there are {known}.")
        typed.append((name, value))
    return lambda run: all(
        any(_equal(value, value_text(one)) for one in _values(run, name)) for name, value in typed
    )


def _values(run: Run, name: str) -> list[Any]:
    """Returns the values of a setting that is named by its path, or by its last part."""
    return [v for path, v in flatten(run).items() if name in (path[-1], ".".join(path))]


def _equal(typed: str, value: str) -> bool:
    """Returns whether a typed text means a value, such as 1e-4 for 0.0001, planar for planar12."""
    try:
        return math.isclose(float(typed), float(value), rel_tol=1e-5)
    except ValueError:
        return typed.replace(" ", "") in (value.replace(" ", ""), shown_representation(value))
