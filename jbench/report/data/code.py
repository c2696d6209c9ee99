"""Runs of different code: they are never in one curve, and each curve says what has changed."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from jbench.report.data.configuration import Configuration
from jbench.settings.code_words import DATE
from jbench.settings.recorded import comparable, without_code
from jbench.store.code import Code, changed_files, code_of, have_changed


def recorded_code(provenance: object) -> dict[str, Any]:
    """Returns what the provenance of a run, as JSON, holds of users' code."""
    if not isinstance(provenance, str) or "source" not in provenance:
        return {}
    values = json.loads(provenance)
    return code_of(values) if isinstance(values, Mapping) else {}


def split_by_code(runs: pd.DataFrame, alike: "pd.Series[str]") -> "pd.Series[str]":
    """Returns a name of the code of each run whose settings do not tell it from others; else "".

    Older versions did not record the code in the settings, only in the provenance. Runs that lack a
    checksum are of the first code that does not contradict it.

    Args:
        runs: in any order, with the columns code and created.
        alike: a key of their settings.
    """
    names = pd.Series("", runs.index, object)
    coded = runs[runs["code"].astype(bool)]
    for key in alike[coded.index].unique():
        same = runs[alike == key].sort_values("created")
        clusters = list[tuple[dict[str, Any], list[Any]]]()
        for index, code in same["code"].items():
            for known, members in clusters:
                if not changed_files(known, code):
                    known |= code
                    members.append(index)
                    break
            else:
                clusters.append((dict(code), [index]))

        if len(clusters) < 2:
            continue
        dates = [str(runs.loc[members[0], "created"])[:DATE] for _, members in clusters]
        for number, (date, (_, members)) in enumerate(zip(dates, clusters, strict=True), 1):
            more = f", {number}" if dates.count(date) > 1 else ""
            names[members] = f"code of {date}{more}"

    return names


def note_changes(
    configurations: Sequence[Configuration], codes: Mapping[str, Code], dates: Mapping[str, str]
) -> None:
    """Adds a note to each configuration whose settings are those of others, but not its code.

    Args:
        codes: what is recorded of the code of each run.
        dates: when each run was begun.
    """
    families = defaultdict[tuple[str, ...], list[Configuration]](list)
    for config in configurations:
        settings = comparable(without_code(config.settings))
        families[config.task, config.algo, config.representation, settings].append(config)

    for family in families.values():
        for config in family:
            others = {c.variant: c for c in family if c.variant != config.variant}
            for other in others.values():
                files = changed_files(codes[other.runs[0]], codes[config.runs[0]])
                what = have_changed(files) if files else "the code has changed"
                begun = min(dates[run] for run in other.runs)[:DATE]
                which = other.words or f"the runs of {begun}"
                note = f"{what} between these runs and {which}: no curve has both"
                config.notes = (*config.notes, note)
