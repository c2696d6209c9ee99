"""What users type: names out of several, and lists of whole numbers.

There are no heavy imports here, so help and completion are fast.
"""

import difflib
import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from jbench.errors import RequestError
from jbench.wording import in_prose

_Name = TypeVar("_Name", bound=str)


def known(noun: str, value: str, names: Sequence[_Name]) -> _Name:
    """Returns the value if it is one of the names; raises a RequestError that lists them if not."""
    for name in names:
        if name == value:
            return name
    advice = suggested(closest(value, names), f"choose {in_prose(names)}")
    raise RequestError(f"Unknown {noun} {value!r}; {advice}.")


def question(close: str | None) -> str:
    """Returns the question whether a similar name was meant, with a space after it; "" of None."""
    if close is None:
        return ""
    return f"did you mean {close}? "


def suggested(close: str | None, advice: str) -> str:
    """Returns advice as a clause, or as a sentence after the question on a similar name."""
    if close is None:
        return advice
    return question(close) + advice[:1].upper() + advice[1:]


def lowered(name: str, names: Iterable[str]) -> str:
    """Returns a name in lower case if it is then one of the names; else as it was typed."""
    if name.lower() in names:
        return name.lower()
    return name


def shown_as(shortened: str, names: Iterable[str]) -> list[str]:
    """Returns the names that a table shows as a text with … in place of a part; else none."""
    if "…" not in shortened:
        return []
    pattern = ".*".join(map(re.escape, shortened.split("…")))
    return [name for name in names if re.fullmatch(pattern, name)]


def closest(value: str, names: Sequence[str]) -> str | None:
    """Returns the name that was probably meant, also by its initials: lr is learning_rate."""
    # As stable-baselines3 describes the networks.
    if value in ("net_arch", "policy", "policy_kwargs") and "hidden_layers" in names:
        return "hidden_layers"
    by_initials = {"".join(word[:1] for word in name.split("_")): name for name in names}
    close = difflib.get_close_matches(str(value).lower(), names, 1)
    return by_initials.get(value) or next(iter(close), None)


def parse_numbers(
    text: str, option: str = "--seeds", example: str = "seeds like 0-9, or 0,2,5-7"
) -> list[int]:
    """Returns the whole numbers of a text like 0-9 or 0,2,5-7, each once, in order.

    Raises a RequestError, which names option and example, if it is not such a text.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"(\d{1,19})(?:-(\d{1,19}))?", part.strip())
        if match is None:
            raise RequestError(f"{option} {text}: type {example}.")

        first = int(match[1])
        last = int(match[2] or first)
        if not 0 <= last - first < 10_000:  # more is a typing error
            raise RequestError(f"{option} {text}: type {example}.")

        numbers.update(range(first, last + 1))

    return sorted(numbers)


def in_ranges(numbers: Iterable[int]) -> str:
    """Returns whole numbers in the form that `parse_numbers` reads, such as 0-4,7."""
    ranges: list[list[int]] = []
    for number in sorted(numbers):
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1] = [ranges[-1][0], number]
        else:
            ranges.append([number])
    return ",".join("-".join(map(str, ends)) for ends in ranges)
