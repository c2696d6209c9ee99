"""Single runs: their frames, where they come from, and what the page shows of one."""

import json
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import ReturnsName, kind_in, shown_representation
from jbench.report.configurations import seed_frame
from jbench.report.data.build import divergence
from jbench.report.data.configuration import ID, with_returns
from jbench.report.data.source_names import OWN
from jbench.report.data.sources import Source
from jbench.report.texts import clean
from jbench.settings.algorithms import display_name
from jbench.settings.recorded import flatten, parse_run
from jbench.settings.run import RunSettings
from jbench.settings.variants import value_text

COLUMNS = [
    "source",
    "run",
    "configuration",
    "label",
    "task",
    "algo",
    "representation",
    "kind",
    "words",
    "seed",
    "steps",
    "final",
    "status",
    "day",
    "diverged",
    "settings",
    "provenance",
]
_RUN_POINTS = 50
_PATH_POINTS = 20
_PAGE_POINTS = 6_000  # of the curves of all runs together
_RECORDED = ("processor", "cores", "threads", "jbench", "python", "git_revision", "command")

_ORIGIN = {"git revision": "commit", "processor": "processor", "command": "command"}
"""What the page shows of a run's provenance, and what it calls it."""


def run_frame(source: Source, returns: ReturnsName) -> pd.DataFrame:
    """Returns a row per run, those without an episode included, by configuration and seed.

    The columns `ID` are empty for a run in no configuration. steps are planned, final is a return
    of the kind `returns`, diverged says when, and settings and provenance are texts by name.
    """
    lead = with_returns(source.configurations, returns)
    known = [*source.configurations, *lead]
    named = {(config.source, run): config for config in known for run in config.runs}
    order = {config.configuration: i for i, config in enumerate(source.configurations)}
    finals = seed_frame(lead).set_index(["source", "run"])["final"].to_dict()
    rows = []
    for recorded in source.runs.to_dict("records"):
        key = str(recorded["source"]), str(recorded["run"])
        representation = str(recorded["representation"])
        row = dict.fromkeys(ID, "") | {n: recorded[n] for n in ("task", "seed", "steps", "status")}
        row["algo"] = display_name(str(recorded["algo"]))
        row["kind"] = kind_in(representation)
        row["representation"] = shown_representation(representation)
        row |= named[key].identity if key in named else {}
        row["source"] = key[0]
        row["run"] = key[1]
        row["final"] = finals.get(key, np.nan)
        row["diverged"] = divergence(recorded["diverged"])[1]
        created = recorded["created"]
        row["day"] = created[:10] if isinstance(created, str) else ""
        row["settings"] = dict(_texts(recorded["settings"]))
        rows.append(row | {"provenance": provenance(recorded["provenance"])})

    rows.sort(key=lambda row: (order.get(row["configuration"], -1), row["seed"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64"})


def run_details(
    runs: pd.DataFrame,
    run_curves: pd.DataFrame,
    metrics: pd.DataFrame,
    paths: pd.DataFrame,
    leading: ReturnsName,
) -> dict[str, Any]:
    """Returns what the script shows of runs beside their rows: settings and steps by number.

    Curves of the leading kind of return come first, unless they have less than five points.
    """
    sizes = run_curves.groupby(["source", "run", "returns"])["steps"].transform("size")
    ordered = run_curves.assign(few=sizes < 5, other=run_curves["returns"] != leading)
    ordered = ordered.sort_values(["few", "other"], kind="stable")
    ordered = ordered.assign(name=ordered["returns"] + " return")
    finite = metrics[np.isfinite(metrics["value"]) & metrics["run"].isin(runs["run"])]
    finite = finite.rename(columns={"control_steps": "steps"}).assign(source=OWN)
    every = pd.concat([ordered, finite])
    groups = every.groupby(["source", "run", "name"], sort=False)
    most = max(2, min(_RUN_POINTS, _PAGE_POINTS // max(1, groups.ngroups)))
    curves: dict[Any, list[list[Any]]] = {}
    steps: dict[tuple[int, ...], int] = {}
    for (source, run, name), points in groups[["steps", "value"]]:
        at = np.linspace(0, len(points) - 1, min(len(points), most)).round().astype(int)
        shown = points.to_numpy(float)[at]
        values = [json.loads(f"{value:.3g}") for value in shown[:, 1]]
        number = steps.setdefault(tuple(shown[:, 0].round().astype(int).tolist()), len(steps))
        curves.setdefault((source, run), []).append([str(name), number, values])

    ways = {key: list(_paths(rows)) for key, rows in paths.groupby(["source", "run"], sort=False)}
    settings: dict[tuple[str, str], int] = {}
    origins: dict[str, int] = {}
    details = []
    for row in runs.to_dict("records"):
        place = row["source"], row["run"]
        texts = [(clean(str(n)), clean(str(v))) for n, v in row["settings"].items()]
        numbers = [settings.setdefault(pair, len(settings)) for pair in texts]
        origin = [
            origins.setdefault(f"{name}: {clean(row['provenance'][key])}", len(origins))
            for key, name in _ORIGIN.items()
            if key in row["provenance"]
        ]
        detail = {"diverged": row["diverged"], "settings": numbers, "origin": origin}
        details.append(detail | {"curves": curves.get(place, []), "paths": ways.get(place, [])})

    return {
        "settings": list(settings),
        "steps": list(steps),
        "origins": list(origins),
        "runs": details,
    }


def _paths(rows: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yields the first and the last path of a run, in tenths of a millimeter, waits left out."""
    steps = sorted(rows["steps"].unique())
    for at in dict.fromkeys((steps[0], steps[-1])):
        path = rows[rows["steps"] == at]
        last = path.iloc[-1]
        path = path.iloc[np.linspace(0, len(path) - 1, min(len(path), _PATH_POINTS)).astype(int)]
        numbers = {name: last[f"target_{name}"] for name in ("x", "y", "yaw")}
        numbers["heading"] = last["heading"]
        known = {n: round(float(v), 3) for n, v in numbers.items() if np.isfinite(v)}
        points = (path[["x", "y"]].to_numpy(np.float64) * 1e4).round().astype(int)
        moved = np.append(True, (points[1:] != points[:-1]).any(axis=1))
        yield {**known, "points": points[moved].ravel().tolist()}


def provenance(recorded: str) -> dict[str, str]:
    """Returns the processor, versions and command of a run, by name; the text is untrusted."""
    values: Any = json.loads(recorded)
    values = values if isinstance(values, dict) else {}
    packages = values.get("packages")
    command = values.get("command")
    if isinstance(command, list):
        values["command"] = " ".join(map(str, command))

    named = {name: values.get(name) for name in _RECORDED}
    named |= packages if isinstance(packages, dict) else {}

    return {
        str(name).replace("_", " "): value if isinstance(value, str) else json.dumps(value)
        for name, value in named.items()
        if value is not None
    }


def provenance_frame(runs: pd.DataFrame) -> pd.DataFrame:
    """Returns the different values of each recorded name over all runs, with numbers of runs."""
    pairs = [pair for named in runs["provenance"] for pair in named.items() if pair[0] != "command"]
    counted = pd.DataFrame(pairs, columns=["name", "value"])
    return counted.value_counts(["name", "value"], sort=False).reset_index(name="runs")


@lru_cache(maxsize=10_000)
def _texts(settings: str) -> tuple[tuple[str, str], ...]:
    """Returns the text of each setting by its name, in the order of the fields of `RunSettings`."""
    run = parse_run(settings)
    order = {name: i for i, name in enumerate(RunSettings.model_fields)}
    ordered = sorted(flatten(run).items(), key=lambda item: (order.get(item[0][0], 99), item[0]))
    return tuple(
        (".".join(path), "none" if value is None else value_text(value)) for path, value in ordered
    )
