"""Learning curves in the form of runs: imported ones, and those of any environment in one file."""

import json
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import ReturnsName
from jbench.settings.recorded import variant
from jbench.store import schema
from jbench.store.record_files import to_table
from jbench.wording import are, counted, in_prose

_LABELS = ["task", "algo", "representation"]
_SEED = [*_LABELS, "seed"]
_RETURNS = {"episodes": "training", "evaluations": "evaluation"}
_EPISODES = ("sb3-monitor", "sb3-evaluations")
"""Formats whose points are episodes or evaluations; points of other formats are logged values."""

_PROVENANCE = ("jbench", "python", "git_revision", "command")
"""What is kept of an import's provenance; its machine is not that of the training."""

_RUN = ["task", "method", "seed"]


class ImportedRuns(NamedTuple):
    """Imported curves as runs.

    Attributes:
        tables: `runs`, `episodes` and `evaluations`.
        notes: sentences on all of them.
        problems: a sentence for each import that is no run.
    """

    tables: dict[str, pa.Table]
    notes: list[str]
    problems: list[str]


def as_runs(imports: pd.DataFrame, points: pd.DataFrame) -> ImportedRuns:
    """Returns the rows of `imports` and `import_points` as those of runs.

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
    runs = runs.assign(
        variant=list(map(variant, known)),
        settings=list(map(json.dumps, known)),
        provenance=list(map(json.dumps, kept)),
    )

    rows = {"runs": to_table(runs, schema.TABLES["runs"])}
    for name, kind in _RETURNS.items():
        rows[name] = to_table(named[named["returns"] == kind], schema.TABLES[name])

    return ImportedRuns(rows, _notes(frame, chosen), problems)


def _notes(frame: pd.DataFrame, chosen: pd.DataFrame) -> list[str]:
    """Returns what a report says of imported curves: that they are not verified, and more."""
    if frame.empty:
        return []

    formats = sorted(set(chosen["format"]))
    notes = [
        f"{counted(len(chosen), 'imported curve')} ({', '.join(formats)}) {are(len(chosen))} not "
        "verified: jbench has not run the agents. Imported curves are in no claim."
    ]
    logged = [name for name in formats if name not in _EPISODES]
    if logged:
        notes.append(
            f"A point of an imported {in_prose(logged)} curve is a value in its file, which need "
            "not be the return of a single episode."
        )

    shorter = len(frame) - len(chosen)
    if shorter:
        notes.append(
            f"{counted(shorter, 'imported curve')} {are(shorter)} not used, since a longer one of "
            "the same seed was imported."
        )

    return notes


def as_imports(points: pd.DataFrame, returns: ReturnsName) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns curves as rows of `imports` and `import_points`, with the method as algorithm."""
    curves = points.groupby(_RUN, sort=False)
    named = {"control_steps": points["steps"], "episode_return": points["return"]}
    numbered = points.assign(point=curves.cumcount(), episode=0, **named)
    numbered["import"] = "curve " + (curves.ngroup() + 1).astype(str)
    imports = numbered.groupby(_RUN, sort=False).last().reset_index()
    texts = {"representation": "", "status": "finished", "format": "csv", "provenance": "{}"}
    algo = imports["method"]
    count = imports["point"] + 1
    return imports.assign(algo=algo, returns=returns, points=count, **texts), numbered


def to_json(points: pd.DataFrame) -> str:
    """Returns points, see `dialects.read_curves`, as the JSON of HumanoidBench."""
    tasks: dict[str, dict[str, dict[str, dict[str, list[float]]]]] = {}
    for key, curve in points.groupby(_RUN, sort=False):
        task, method, seed = map(str, key)
        tasks.setdefault(task, {}).setdefault(method, {})[f"seed_{seed}"] = {
            "million_steps": (curve["steps"] / 1e6).tolist(),
            "return": curve["return"].tolist(),
        }
    return json.dumps(tasks, allow_nan=False) + "\n"
