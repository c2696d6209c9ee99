"""How names call users' code: the beginning of its checksum, and the date of its first record."""

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

from jbench.settings.base import canonical_json
from jbench.settings.recorded import Run

CODE_LENGTH = 6
"""Characters of a checksum of users' code in names."""

DATE = 10
"""Characters of a date, such as 2026-11-28."""

CODE_WORDS = {"sources": "code", "compiled": "robot", "accepted": "changed code"}
"""Settings that are checksums of users' code, and what names call them."""


def code_word(name: str, value: Any, dates: Mapping[str, str]) -> str:
    """Returns the beginning of a checksum of code and its date; nothing for other settings."""
    kind = CODE_WORDS.get(name.rpartition(".")[2])
    if kind is None or not isinstance(value, str):
        return ""
    date = f" of {dates[value]}" if value in dates else ""
    return f"{kind} {value[:CODE_LENGTH]}{date}"


def code_checksums(run: Run) -> list[str]:
    """Returns the checksums of users' code that the settings of a run have."""
    specs = run.values.get("specs")
    holders = (run.values, specs if isinstance(specs, Mapping) else {})
    values = (holder.get(name) for holder, name in product(holders, CODE_WORDS))
    return [value for value in values if isinstance(value, str)]


def code_dates(runs: Iterable[tuple[Run, object]]) -> dict[str, str]:
    """Returns the date of the first run with each checksum of code; runs come with when they began.

    The dates are those of manifests, to the day.
    """
    return first_dates(
        (checksum, created) for run, created in runs for checksum in code_checksums(run)
    )


def first_dates(checksums: Iterable[tuple[object, object]]) -> dict[str, str]:
    """Returns the date of the first record with each checksum, of those that have one.

    Checksums come with when their record was begun.
    """
    dates: dict[str, str] = {}
    for checksum, created in checksums:
        if isinstance(checksum, str):
            date = str(created)[:DATE]
            dates[checksum] = min(date, dates.get(checksum, date))

    return dates


def encoder_words(encoders: Iterable[tuple[str, Mapping[str, Any], object]]) -> dict[str, str]:
    """Returns the words for the code of encoders, by id, where others differ only in their code.

    Args:
        encoders: id, settings and when it was begun, of each encoder.
    """
    every = list(encoders)
    dates = first_dates((settings.get("sources"), created) for _, settings, created in every)
    alike: dict[str, dict[str, str]] = {}
    for id, settings, _ in every:
        others = {name: value for name, value in settings.items() if name != "sources"}
        word = code_word("sources", settings.get("sources"), dates)
        alike.setdefault(canonical_json(others), {})[id] = word

    groups = (words for words in alike.values() if len(words) > 1)
    return {id: word for words in groups for id, word in words.items() if word}
