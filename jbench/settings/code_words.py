"""How names call users' code: the beginning of its checksum, and the date of its first record.

Versions of one day have the time as well.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, starmap
from typing import Any, NamedTuple

from jbench.settings.base import canonical_json
from jbench.settings.recorded import Run

CODE_LENGTH = 6
"""Characters of a checksum of users' code in names."""

DATE = 10
"""Characters of a date, such as 2026-11-28."""

_MINUTE = 16
"""Characters of a time up to its minute, such as 2026-11-28T13:05."""

CODE_WORDS = {"sources": "code", "compiled": "robot", "accepted": "changed code"}
"""Settings that are checksums of users' code, and what names call them."""


def code_word(name: str, value: Any, dates: Mapping[str, str]) -> str:
    """Returns the beginning of a checksum of code and its date; nothing for other settings."""
    kind = CODE_WORDS.get(name.rpartition(".")[2])
    if kind is None or not isinstance(value, str):
        return ""

    word = f"{kind} {value[:CODE_LENGTH]}"
    if value in dates:
        word += f" of {dates[value]}"
    return word


class CodeVersion(NamedTuple):
    """A version of users' code, as a record has it.

    Attributes:
        code: which code it is a version of, such as that of a task.
        checksum: of its files; anything else but a text if the record has none.
        created: when the record was begun.
    """

    code: object
    checksum: object
    created: object


def code_checksums(run: Run) -> list[str]:
    """Returns the checksums of users' code that the settings of a run have."""
    versions = (version.checksum for version in _code_versions(run, ""))
    return [checksum for checksum in versions if isinstance(checksum, str)]


def _code_versions(run: Run, created: object) -> Iterator[CodeVersion]:
    """Yields the code of the algorithm and of the task of a run, which was begun at a time."""
    specs = run.values.get("specs")
    for name in CODE_WORDS:
        yield CodeVersion(("algo", run.algo, name), run.values.get(name), created)
        if isinstance(specs, Mapping):
            yield CodeVersion(("task", run.task, name), specs.get(name), created)


def code_dates(runs: Iterable[tuple[Run, object]]) -> dict[str, str]:
    """Returns the date of the first run with each checksum of code; see `first_dates`.

    Args:
        runs: settings, and when the run was begun.
    """
    return first_dates(chain.from_iterable(starmap(_code_versions, runs)))


def first_dates(versions: Iterable[CodeVersion]) -> dict[str, str]:
    """Returns the date of the first record with each checksum, such as `2026-11-28`, in UTC.

    Two versions of the same code that have the same date also have the time: `2026-11-28 13:05`.
    """
    begun: dict[str, str] = {}
    checksums: dict[object, set[str]] = {}
    for version in versions:
        if isinstance(version.checksum, str):
            created = str(version.created)
            begun[version.checksum] = min(created, begun.get(version.checksum, created))
            checksums.setdefault(version.code, set()).add(version.checksum)

    dates: dict[str, str] = {}
    for same_code in checksums.values():
        shown = with_times([begun[checksum] for checksum in same_code])
        for checksum, date in zip(same_code, shown, strict=True):
            # Tasks may share their code, and one may have another version of the same day.
            dates[checksum] = max(date, dates.get(checksum, ""), key=len)

    return dates


def with_times(begun: Sequence[str]) -> list[str]:
    """Returns the dates of versions of some code; those of one date have the time as well.

    Args:
        begun: when each version was first used, such as `2026-11-28T13:05:17+00:00`.
    """
    dates = [created[:DATE] for created in begun]
    counts = Counter(dates)
    for i, created in enumerate(begun):
        if counts[created[:DATE]] > 1:
            dates[i] = _minute(created)

    return dates


def _minute(created: str) -> str:
    """Returns a time up to its minute, such as `2026-11-28 13:05`."""
    return created[:_MINUTE].replace("T", " ")


def encoder_words(encoders: Iterable[tuple[str, Mapping[str, Any], object]]) -> dict[str, str]:
    """Returns the words for the code of encoders, by id, where others differ only in their code.

    Args:
        encoders: id, settings and when it was begun, of each encoder.
    """
    every = list(encoders)
    dates = first_dates(
        CodeVersion(str(settings.get("kind")), settings.get("sources"), created)
        for _, settings, created in every
    )
    alike: dict[str, dict[str, str]] = {}
    for id, settings, _ in every:
        others = {name: value for name, value in settings.items() if name != "sources"}
        word = code_word("sources", settings.get("sources"), dates)
        alike.setdefault(canonical_json(others), {})[id] = word

    shown = dict[str, str]()
    for words in alike.values():
        if len(words) > 1:
            shown |= {id: word for id, word in words.items() if word}

    return shown
