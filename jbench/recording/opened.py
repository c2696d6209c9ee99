"""`jbench.open`: a results directory as pandas data frames."""

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from jbench.array_types import FloatArray
from jbench.errors import NothingYetError
from jbench.names import RETURNS, Order, ReturnsName
from jbench.report.configurations import seed_frame
from jbench.report.data import sources
from jbench.report.data.configuration import Configuration, with_returns
from jbench.report.data.curves import QUANTILES, Curve
from jbench.report.data.points import Part, long_frame
from jbench.report.request import WINDOW, Request, representations_meant
from jbench.representation_names import shown_representation
from jbench.returns import last_evaluation_return
from jbench.settings.base import validated
from jbench.settings.recorded import Run, flatten, parse_run
from jbench.store import Results, query
from jbench.store.evaluations import ADDED
from jbench.store.shipped import results_to_read
from jbench.wording import in_prose

_RUN = [
    "run",
    "task",
    "algo",
    "representation",
    "encoder",
    "variant",
    "source",
    "seed",
    "steps",
    "status",
    "wall_time",
    "error",
]
_CURVE = ["task", "algo", "representation", "variant", "source"]
_key = attrgetter(*_CURVE)  # of a configuration; both kinds of return of the same runs share it
_QUANTILES = [f"q{percent}" for percent in QUANTILES]
_POINT = ["returns", "order", "window", "control_steps", "seeds", *_QUANTILES]
_SEED_POINT = ["run", "seed", "returns", "window", "control_steps", "episode_return"]


def open(path: Path | str = "results") -> "OpenedResults":
    """Opens a results directory to read, or raises a RequestError if there is none.

    Args:
        path: of the directory; "reference" for the results shipped with jbench, unless there is a
            directory of that name.
    """
    return OpenedResults(results_to_read(path))


class OpenedResults:
    """A results directory whose rows are read as pandas data frames.

    Damaged records are left out, each with a `UserWarning`.
    """

    def __init__(self, results: Results) -> None:
        """Reads nothing yet."""
        self._results = results

    def __repr__(self) -> str:
        """The call that opens these results."""
        return f"jbench.open({str(self._results.name)!r})"

    def query(self, sql: str) -> pd.DataFrame:
        """Returns the rows of one SELECT, as `jbench query` does; docs/database.md has the tables.

        A `UserWarning` names each representation that is stored under a longer name, such as
        planar12 for planar.

        Raises a RequestError if it is not one SELECT, or DuckDB reports an error.
        """
        rows, problems, notes = query.query_results(self._results, sql)
        for sentence in problems + notes:
            warnings.warn(sentence, stacklevel=2)
        return rows

    def runs(
        self,
        task: str | None = None,
        algo: str | None = None,
        representation: str | None = None,
    ) -> pd.DataFrame:
        """Returns the runs with their final returns and settings; imported curves are runs as well.

        Raises a RequestError if there are no such runs.

        Args:
            task: only this task.
            algo: only this algorithm.
            representation: only this one, by its whole name or by the one that reports show, such
                as planar12 or planar, or all of a kind, such as dae.

        Returns:
            A row for each run: run, task, algo, representation, shown_representation (as reports
            show it: planar for planar12), encoder, variant, source, seed, steps, status, wall_time
            (s), error (why a run failed), evaluation_return and training_return (final returns as
            in `jbench report`; NaN if there is none, or a longer run of the seed counts there),
            evaluation_return_at_end (without the episodes that `jbench evaluate` added), and a
            column for each other setting, such as learning_rate. Settings that an algorithm does
            not have are missing values.
        """
        request = _request("the runs", task, algo)
        source = self._rows(request, representation)
        seeds = seed_frame(source.configurations)
        finals = seeds.pivot(index=["source", "run"], columns="returns", values="final")
        finals = finals.reindex(columns=[*RETURNS]).add_suffix("_return")
        runs = source.runs[_RUN].reset_index(drop=True).join(finals, on=["source", "run"])
        # No episodes are added to a run that diverged: see `returns.diverged_return`.
        has_diverged = source.runs["diverged"].notna().to_numpy()
        at_end = _returns_at_end(source)
        runs["evaluation_return_at_end"] = np.where(has_diverged, runs["evaluation_return"], at_end)
        shown = runs["representation"].map(shown_representation)
        runs.insert(_RUN.index("representation") + 1, "shown_representation", shown)
        settings = _settings([parse_run(text) for text in source.runs["settings"]])
        return runs.join(settings.drop(columns=runs.columns, errors="ignore"))

    def curves(
        self,
        task: str | None = None,
        algo: str | None = None,
        returns: ReturnsName = "evaluation",
        window: int = WINDOW,
        order: Order = "quantile-first",
        *,
        per_seed: bool = False,
        representation: str | None = None,
    ) -> pd.DataFrame:
        """Returns the learning curves that `jbench report` draws.

        Raises a RequestError if an argument is invalid, or there are no such runs.

        Args:
            task: only this task.
            algo: only this algorithm.
            returns: "evaluation" or "training".
            window: episodes in a moving average of training returns.
            order: see `jbench.names.ORDERS`.
            per_seed: whether to return the curve of each seed instead of quantiles across seeds.
            representation: only this one, as in `runs`.

        Returns:
            A row for each point of each curve: task, algo, representation, variant, source,
            returns, order, window, control_steps, seeds, q10, q25, q50, q75, q90; with per_seed,
            run, seed and episode_return instead of the order and quantiles. The column settings
            names the settings that differ from the defaults, as the legends of a report do; each
            setting that differs between the curves has a column of its own, such as learning_rate.
        """
        typed = {"returns": returns, "window": window, "order": order}
        request = _request("the curves", task, algo, **typed)
        source = self._rows(request, representation)

        chosen = with_returns(source.configurations, returns)
        parts = []
        columns = [*_CURVE]
        if per_seed:
            columns += _SEED_POINT
            for configuration in chosen:
                parts += _points_of_seeds(configuration, configuration.curve(order, window))
        else:
            columns += _POINT
            for configuration in sorted(chosen, key=_key):
                parts.append(_points(configuration, configuration.curve(order, window)))

        points = long_frame(parts, columns)

        named = pd.DataFrame(list(map(_key, chosen)), columns=_CURVE)
        named["settings"] = [configuration.words for configuration in chosen]
        settings = _settings([configuration.settings for configuration in chosen])
        values = settings.astype(str).nunique(dropna=False)
        differing = values.index[values > 1]
        named = named.join(settings[differing].drop(columns=points.columns, errors="ignore"))
        return points.merge(named, on=_CURVE, how="left")

    def _rows(self, request: Request, representation: str | None) -> sources.Source:
        """Returns the runs that a request means; those that can't be read are warnings."""
        source = sources.own_and_imported(self._results, request)
        for problem in source.problems:
            warnings.warn(problem, stacklevel=3)

        if representation is None:
            return source

        return _with_representation(source, representation)


def _request(what: str, task: str | None, algo: str | None, **typed: Any) -> Request:
    """Returns the request of runs or curves; a RequestError if a value is invalid."""
    algos = () if algo is None else (algo,)
    return validated(Request, what, task=task, algo=algos, **typed)


def _with_representation(source: sources.Source, typed: str) -> sources.Source:
    """Returns the runs with a representation; see `representations_meant` for its name."""
    known = sorted({str(name) for name in source.runs["representation"]})
    meant = representations_meant(typed, known)
    if not meant:
        problem = f"There are no runs with the representation {typed!r}"
        if known:
            problem += f"; there are {in_prose(known, 'and')}"
        raise NothingYetError(f"{problem}.")

    configurations = [c for c in source.configurations if c.representation in meant]
    runs = source.runs[source.runs["representation"].isin(meant)]
    return replace(source, configurations=configurations, runs=runs)


def _returns_at_end(source: sources.Source) -> FloatArray:
    """Returns the `last_evaluation_return` (runs,) without the episodes of `jbench evaluate`.

    It is NaN for a run without evaluations.
    """
    # The means of imported evaluations have no number of an episode.
    own = pc.field("episode").is_null() | (pc.field("episode") < ADDED)
    rows = source.evaluations.filter(own).to_pandas(use_threads=False)
    ends = {
        run: last_evaluation_return(of["evaluation"].to_numpy(), of["episode_return"].to_numpy())
        for run, of in rows.groupby("run")
    }
    return np.array(source.runs["run"].map(ends), np.float64)


def _names(configuration: Configuration) -> dict[str, Any]:
    """Returns what the points of a curve have in common, by column."""
    names = dict(zip(_CURVE, _key(configuration), strict=True))
    names["returns"] = configuration.returns_name
    return names


def _points(configuration: Configuration, curve: Curve) -> Part:
    """Returns the points of a curve, which are quantiles across seeds."""
    names = _names(configuration) | {"order": curve.order, "seeds": curve.seeds}
    quantiles = dict(zip(_QUANTILES, curve.quantiles, strict=True))
    arrays = {"window": curve.widths, "control_steps": curve.control_steps}
    return names, arrays | quantiles


def _points_of_seeds(configuration: Configuration, curve: Curve) -> list[Part]:
    """Returns the points of each seed's curve."""
    names = _names(configuration)
    parts: list[Part] = []
    for run, seed, mine in zip(configuration.runs, configuration.seeds, curve.by_seed, strict=True):
        points = {"window": mine.widths, "control_steps": mine.control_steps}
        parts.append((names | {"run": run, "seed": seed}, points | {"episode_return": mine.values}))

    return parts


def _settings(runs: Sequence[Run]) -> pd.DataFrame:
    """Returns a row for each run and a column for each setting, by the last part of its name."""
    flat = [flatten(run) for run in runs]
    paths = list(dict.fromkeys(chain.from_iterable(flat)))
    last = Counter(path[-1] for path in paths)
    names = {path: path[-1] if last[path[-1]] == 1 else ".".join(path) for path in paths}
    columns = {name: [settings.get(path) for settings in flat] for path, name in names.items()}
    # A whole number stays one beside missing values.
    return pd.DataFrame(columns, index=range(len(flat))).convert_dtypes()
