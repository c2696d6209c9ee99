"""What repeats the runs of a report, and how many of them dropped out."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jbench.report.data.source_names import FILE, IMPORTED
from jbench.report.data.sources import Source
from jbench.report.texts import clean
from jbench.store import Results
from jbench.studies.commands import commands
from jbench.studies.rebuilt_matrix import matrix_text
from jbench.wording import counted

_NOT_TRAINED = (IMPORTED, FILE)
"""Sources whose runs jbench neither trained nor recorded."""


@dataclass(frozen=True)
class Repetition:
    """What trains the runs of a report again.

    Attributes:
        matrix: a matrix file for `jbench sweep`; "" without runs.
        typed: the recorded command lines, each once.
        rebuilt: command lines for the runs that have no recorded one.
    """

    matrix: str
    typed: list[str]
    rebuilt: list[str]


def repetition(source: Source, results: Results | None) -> Repetition:
    """Returns what trains the runs of a source again; texts are those of the records.

    The results have the datasets; they are None for a file of curves.
    """
    runs = source.runs[~source.runs["source"].isin(_NOT_TRAINED)]
    if runs.empty:
        return Repetition("", [], [])
    settings = [json.loads(text) for text in runs["settings"]]
    encoders = {
        str(row["encoder"]): json.loads(row["settings"])
        for row in source.tables["encoders"].to_dict("records")
    }
    records = [] if results is None else results.scan("dataset")[0]
    datasets = {record.id: record.settings for record in records}
    words = [_command(text) for text in runs["provenance"]]
    made = commands(zip(settings, words, strict=True))
    lines = matrix_text(settings, encoders, datasets).splitlines()
    return Repetition(
        matrix="\n".join(clean(line) for line in lines),
        typed=[clean(line) for line in made.typed],
        rebuilt=[clean(line) for line in made.rebuilt],
    )


def _command(provenance: Any) -> Any:
    """Returns the words of the recorded command, if there are any; the text is untrusted."""
    values = json.loads(provenance) if isinstance(provenance, str) else None
    return values.get("command") if isinstance(values, dict) else None


def drops(runs: pd.DataFrame, problems: Sequence[str]) -> str:
    """Returns how many runs failed, are unfinished, or are left out; "" without any.

    Others may have no final return of the kind that the page shows first.

    Args:
        runs: see `run_frame`.
        problems: a sentence for each unreadable record.
    """
    trained = runs[~runs["source"].isin(_NOT_TRAINED)]
    if trained.empty and not problems:
        return ""
    ended = trained["status"]
    others = trained[~ended.isin(["failed", "unfinished"])]
    is_unused = others["configuration"] == ""
    counts = {
        "failed": int((ended == "failed").sum()),
        "unfinished": int((ended == "unfinished").sum()),
        "left out": int(is_unused.sum()),
        "without a final return": int((~is_unused & others["final"].isna()).sum()),
        "unreadable": len(problems),
    }
    parts = [f"{count} {what}" for what, count in counts.items() if count]
    if not parts:
        return "No run failed, is unfinished or is left out."
    return f"Of {counted(len(trained), 'run')}: {', '.join(parts)}."
