"""Reading what users type: names, counts and seeds."""

from collections.abc import Sequence
from typing import TypeVar

from jbench.errors import RequestError
from jbench.names import LARGEST_SEED

_MOST_NUMBERS = 10_000  # in one range; more is a slip of the keyboard

_Name = TypeVar("_Name", bound=str)


def known(what: str, value: str, names: Sequence[_Name]) -> _Name:
    """Returns the value if it is one of the names.

    Raises:
        RequestError: if it is none; it says which there are.
    """
    for name in names:
        if name == value:
            return name
    import difflib

    close = difflib.get_close_matches(value, names, 1)
    hint = f"did you mean {close[0]}? There" if close else "there"
    raise RequestError(f"No {what} {value!r}; {hint} are {', '.join(names)}.")


def count(option: str, text: str) -> int:
    """Returns a positive whole number typed as 5000000, 5_000_000 or 5e6.

    Raises:
        RequestError: if it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = 0.5
    if not (number >= 1 and number.is_integer() and number <= 1e15):
        raise RequestError(f"{option} {text}: type a positive whole number, such as 100000 or 5e6.")
    return int(number)


def seed(number: int) -> int:
    """Returns a seed.

    Raises:
        RequestError: if it is negative, or larger than the database can keep.
    """
    if not 0 <= number <= LARGEST_SEED:
        raise RequestError(f"--seed {number}: type a whole number from 0 up to {LARGEST_SEED}.")
    return number


def augmented(number: int | None) -> int | None:
    """Returns the seed of an augmented robot, if one was asked for.

    Raises:
        RequestError: if it is negative.
    """
    if number is not None and not 0 <= number <= LARGEST_SEED:
        raise RequestError(f"--augment {number}: type a whole number from 0 up to {LARGEST_SEED}.")
    return number


def seeds(text: str) -> list[int]:
    """Returns the seeds of a text like 0-9 or 0,2,5-7, each once, in order.

    Raises:
        RequestError: if it is no such text.
    """
    return numbers("--seeds", text, "seeds like 0-9, or 0,2,5-7")


def numbers(option: str, text: str, example: str) -> list[int]:
    """Returns the whole numbers of a text like 0-9 or 0,2,5-7, each once, in order.

    Args:
        option: that the text was typed for.
        text: what was typed.
        example: of what to type, for the error.

    Raises:
        RequestError: if it is no such text.
    """
    chosen: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        whole = first.isdecimal() and (not dash or last.isdecimal())
        if not whole or not 0 <= int(last or first) - int(first) < _MOST_NUMBERS:
            raise RequestError(f"{option} {text}: type {example}.")
        chosen.update(range(int(first), int(last or first) + 1))
    return sorted(chosen)


def all_cores(wanted: int) -> int:
    """Returns how many to run at a time: as many as wanted, or for 0 one on each core.

    Raises:
        RequestError: if it is negative.
    """
    from jbench.store.provenance import cores

    if wanted < 0:
        raise RequestError(f"{wanted} at a time can't be; type 0 for one on each core.")
    return wanted or cores()
