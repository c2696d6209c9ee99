"""A line of a check."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from jbench.errors import ERRORS_OF_OTHERS, sentence_of_failure

CheckState = Literal["ok", "note", "fails"]
"""`note`: it works, but some command can do less; `fails`: commands will fail."""


NamedCheck = tuple[str, Callable[[], str]]
"""A name, and a function that returns a sentence, or raises an error that is one."""


class Checked(NamedTuple):
    """What was looked at, how it is, and one sentence on it."""

    name: str
    state: CheckState
    text: str


class NotableError(Exception):
    """Ends a check with a note."""


def attempt(name: str, check: Callable[[], str]) -> Checked:
    """Returns the line of a check, which returns its text, or raises an error that says why not."""
    try:
        return Checked(name, "ok", check())
    except NotableError as note:
        return Checked(name, "note", str(note))
    except ERRORS_OF_OTHERS as error:  # of any type, since the code is that of others
        return Checked(name, "fails", sentence_of_failure(error))
