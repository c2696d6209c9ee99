"""Frames of single runs, and of where they come from."""

import json
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import ReturnsName
from jbench.report.configurations import seed_frame
from jbench.report.data.build import divergence
from jbench.report.data.configuration import ID, with_returns
from jbench.report.data.sources import Source
from jbench.representation_names import kind_in, shown_representation
from jbench.settings.algorithms import display_name
from jbench.settings.labels import value_text
from jbench.settings.recorded import flatten, parse_run
from jbench.settings.run import RunSettings

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
_RECORDED = ("processor", "cores", "threads", "jbench", "python", "git_revision", "command")


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
        created = recorded["created"]
        if key in named:
            names = named[key].identity
        else:
            names = {
                **dict.fromkeys(ID, ""),
                "task": recorded["task"],
                "algo": display_name(str(recorded["algo"])),
                "representation": shown_representation(representation),
                "kind": kind_in(representation),
            }

        row = {
            **names,
            "source": key[0],
            "run": key[1],
            "seed": recorded["seed"],
            "steps": recorded["steps"],
            "status": recorded["status"],
            "final": finals.get(key, np.nan),
            "diverged": divergence(recorded["diverged"])[1],
            "day": created[:10] if isinstance(created, str) else "",
            "settings": dict(_texts(recorded["settings"])),
            "provenance": readable_provenance(recorded["provenance"]),
        }
        rows.append(row)

    rows.sort(key=lambda row: (order.get(row["configuration"], -1), row["seed"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64"})


def readable_provenance(recorded: str) -> dict[str, str]:
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
    counts = counted.value_counts(["name", "value"], sort=False).reset_index(name="runs")
    order = pd.factorize(counts["name"])[0]  # all values of a name together
    return counts.iloc[np.argsort(order, kind="stable")].reset_index(drop=True)


@lru_cache(maxsize=10_000)
def _texts(settings: str) -> tuple[tuple[str, str], ...]:
    """Returns the text of each setting by its name, in the order of the fields of `RunSettings`."""
    run = parse_run(settings)
    order = {name: i for i, name in enumerate(RunSettings.model_fields)}
    ordered = sorted(flatten(run).items(), key=lambda item: (order.get(item[0][0], 99), item[0]))
    return tuple(
        (".".join(path), "none" if value is None else value_text(value)) for path, value in ordered
    )
