"""Frames of single runs, and where they come from."""

import json
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import ReturnsName, kind_in
from jbench.report.configurations import seed_frame
from jbench.report.data.build import divergence
from jbench.report.data.configuration import ID, display_name, shown_representation, with_returns
from jbench.report.data.sources import Source
from jbench.settings.alike import flatten
from jbench.settings.recorded import parse_run
from jbench.settings.run import RunSettings
from jbench.settings.variants import value_text

COLUMNS = [
    *("source", "run", "configuration", "label", "task", "algo", "representation", "kind", "words"),
    *("seed", "steps", "final", "status", "day", "diverged", "settings", "provenance"),
]
_COPIED = ("task", "seed", "steps", "status")
METRICS = ["run", "name", "steps", "value"]
_RECORDED = ("processor", "cores", "threads", "jbench", "python", "git_revision", "command")


def run_frame(source: Source, returns: ReturnsName) -> pd.DataFrame:
    """Returns a row per run, those without an episode included.

    Columns: source, run, the other columns `ID` (empty for a run in no configuration), seed, steps
    (planned), final (return, of the kind `returns`), status, day (of its beginning), diverged
    (when, or empty), settings (texts by name) and provenance (texts by name). Runs are in the order
    of their configurations and seeds.
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
        row = dict.fromkeys(ID, "") | {name: recorded[name] for name in _COPIED}
        row |= {"algo": display_name(str(recorded["algo"])), "kind": kind_in(representation)}
        row["representation"] = shown_representation(representation)
        row |= named[key].identity if key in named else {}
        row |= {"source": key[0], "run": key[1], "final": finals.get(key, np.nan)}
        diverged, created = divergence(recorded["diverged"]), recorded["created"]
        row["diverged"] = diverged[1] if diverged else ""
        row["day"] = created[:10] if isinstance(created, str) else ""
        row["settings"] = dict(_texts(recorded["settings"]))
        rows.append(row | {"provenance": provenance(recorded["provenance"])})
    rows.sort(key=lambda row: (order.get(row["configuration"], -1), row["seed"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64"})


def metric_frame(source: Source) -> pd.DataFrame:
    """Returns the finite metrics that runs of the results have recorded, by control step."""
    if "metrics" not in source.tables:
        return pd.DataFrame(columns=METRICS)
    rows = source.tables["metrics"].to_pandas(use_threads=False)
    rows = rows[np.isfinite(rows["value"]) & rows["run"].isin(source.runs["run"])]
    named: pd.DataFrame = rows.rename(columns={"control_steps": "steps"})[METRICS]
    return named


def provenance(recorded: str) -> dict[str, str]:
    """Returns the processor, versions and command of a run, by name; the text is untrusted."""
    values: Any = json.loads(recorded)
    values = values if isinstance(values, dict) else {}
    packages, command = values.get("packages"), values.get("command")
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
