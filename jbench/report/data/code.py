"""Runs of different code: they are never in one curve, and each curve says what has changed."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import dropwhile, zip_longest
from typing import Any

import pandas as pd

from jbench.report.data.configuration import Configuration
from jbench.report.request import settings_typed
from jbench.settings.code_words import code_checksums, with_times
from jbench.settings.recorded import comparable, without_code
from jbench.store.code import Code, changed_files, code_of, have_changed


def recorded_code(provenance: object) -> dict[str, Any]:
    """Returns what the provenance of a run, as JSON, holds of users' code."""
    if not isinstance(provenance, str) or "source" not in provenance:
        return {}
    values = json.loads(provenance)
    return code_of(values) if isinstance(values, Mapping) else {}


def _dated_code(runs: pd.DataFrame, alike: "pd.Series[str]") -> "pd.Series[str]":
    """Returns a name of the code of each run by its date, such as `code of 2026-11-28`.

    Versions of one date have the time, `code of 2026-11-28 13:05`, and of one minute a number.
    Runs with equal settings may be of different code, since older versions recorded the code only
    in the provenance. Runs that lack a checksum are of the first code that does not contradict it.
    The name is "" for runs of whose code, and that of runs like them, nothing is recorded.

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

        dates = with_times([str(runs.loc[members[0], "created"]) for _, members in clusters])
        for position, (_, members) in enumerate(clusters):
            date = dates[position]
            number = dates[: position + 1].count(date)
            more = f" ({number})" if dates.count(date) > 1 else ""
            names[members] = f"code of {date}{more}"

    return names


def split_by_code(
    runs: pd.DataFrame, alike: "pd.Series[str]", *, every: bool = False
) -> "pd.Series[str]":
    """Returns `_dated_code` of each run whose settings do not tell its code from others; else "".

    They do if they have a checksum of it, or if all runs with these settings are of one code, and
    there are none that differ in the checksum of their code only.

    Args:
        runs: in any order, with the columns typed, code and created.
        alike: a key of their settings.
        every: whether runs without a checksum have their name also if there is no other code.
    """
    names = _dated_code(runs, alike)
    coded = runs[names != ""]
    keys = alike[coded.index]
    has_several = names[coded.index].groupby(keys).transform("nunique") > 1
    of_any_code = coded["typed"].map(lambda run: comparable(run, "sources"))
    has_others = keys.groupby(of_any_code).transform("nunique") > 1
    lacks_checksum = coded["typed"].map(lambda run: not code_checksums(run)).astype(bool)
    is_named = has_several | (lacks_checksum & (has_others | every))
    return names.where(is_named.reindex(runs.index, fill_value=False), "")


def own_words(words: str, others: str) -> str:
    """Returns the words of a name after those with which another one begins, too."""
    pairs = zip_longest(settings_typed(words), settings_typed(others))
    own = dropwhile(lambda pair: pair[0] == pair[1], pairs)
    return ", ".join(word for word, _ in own if word is not None)


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
                begun = [min(dates[run] for run in each.runs) for each in (config, other)]
                _, date = with_times(begun)
                which = own_words(other.words, config.words) or f"the runs of {date}"
                note = f"{what} between these runs and {which}: no curve has both"
                config.notes = (*config.notes, note)
