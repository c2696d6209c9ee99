"""Imported learning curves in the form of runs, from which configurations are built."""

import json
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.names import in_prose
from jbench.settings.recorded import variant
from jbench.store import schema
from jbench.store.listed import to_table
from jbench.wording import are, counted

_LABELS = ["task", "algo", "representation"]
_SEED = [*_LABELS, "seed"]
_RETURNS = {"episodes": "training", "evaluations": "evaluation"}
_EPISODES = ("sb3-monitor", "sb3-evaluations")
"""Formats whose points are episodes or evaluations; points of other formats are logged values."""

_PROVENANCE = ("jbench", "python", "git_revision", "command")
"""What is kept of an import's provenance; its machine is not that of the training."""


def as_runs(
    imports: pd.DataFrame, points: pd.DataFrame
) -> tuple[dict[str, pa.Table], list[str], list[str]]:
    """Returns tables of runs from the rows of `imports` and `import_points`; notes and problems.

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
    tables = {"runs": to_table(_runs(chosen), schema.TABLES["runs"])}
    for name, kind in _RETURNS.items():
        tables[name] = to_table(named[named["returns"] == kind], schema.TABLES[name])
    return tables, _notes(frame, chosen), problems


def _runs(chosen: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each seed, with the settings that jbench knows: its labels."""
    runs = chosen.drop_duplicates("run")
    labels: list[Any] = runs[_LABELS].astype(str).to_dict("records")
    settings = [
        json.dumps({**names, "seed": seed})
        for names, seed in zip(labels, runs["seed"].tolist(), strict=True)
    ]
    recorded = map(json.loads, runs["provenance"])
    kept = [{name: made[name] for name in _PROVENANCE if name in made} for made in recorded]
    made_on = list(map(json.dumps, kept))
    return runs.assign(variant=list(map(variant, labels)), settings=settings, provenance=made_on)


def _notes(frame: pd.DataFrame, chosen: pd.DataFrame) -> list[str]:
    if frame.empty:
        return []
    formats = sorted(set(chosen["format"]))
    notes = [
        f"{counted(len(chosen), 'imported curve')} ({', '.join(formats)}) {are(len(chosen))} not "
        "verified: jbench has not run the agents. Imported curves are in no claim."
    ]
    if logged := [name for name in formats if name not in _EPISODES]:
        notes.append(
            f"A point of an imported {in_prose(logged)} curve is a value in its file, which need "
            "not be the return of a single episode."
        )
    if shorter := len(frame) - len(chosen):
        notes.append(
            f"{counted(shorter, 'imported curve')} {are(shorter)} not used, since a longer one of "
            "the same seed was imported."
        )
    return notes
