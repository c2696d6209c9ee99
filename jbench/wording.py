"""Wording that messages, tables and figures share."""

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jbench.names import RESULTS


def progress_text(done: float, planned: float | None) -> str:
    """Formats progress: `60,000 of 100,000`, or `100,000` if all is done or no end is planned."""
    if planned in (None, done):
        return f"{done:,}"
    return f"{done:,} of {planned:,}"


def padded(number: str, width: int) -> str:
    """Returns a number with figure spaces before it, which are as wide as digits."""
    return number.rjust(width, "\N{FIGURE SPACE}")


def not_formula(value: Any) -> Any:
    """Returns a value for a CSV file; a formula of a spreadsheet gets a quote before it."""
    if not (isinstance(value, str) and value[:1] in ("=", "+", "-", "@") and len(value) > 1):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def counted(count: int, noun: str, plural: str = "") -> str:
    """Formats a number of things: `1 seed`, `1,200 seeds`; the plural ends in s by default."""
    if count == 1:
        return f"{count:,} {noun}"
    return f"{count:,} {plural or f'{noun}s'}"


def are(count: int) -> str:
    """Returns the verb for a number of things."""
    return "is" if count == 1 else "are"


def were(count: int) -> str:
    """Returns the same verb in the past."""
    return "was" if count == 1 else "were"


def have(count: int) -> str:
    """Returns the other verb for a number of things."""
    return "has" if count == 1 else "have"


def with_article(noun: str) -> str:
    """Returns a noun after `a` or `an`."""
    if noun[0] in "aeiou":
        return f"an {noun}"
    return f"a {noun}"


def printable(text: str, instead: str = "\ufffd", keeping: str = "") -> str:
    """Returns a text with another character in place of each that can't be printed.

    Those of `keeping`, such as a line feed, stay.
    """
    return "".join(
        character if character.isprintable() or character in keeping else instead
        for character in text
    )


def duration(seconds: float) -> str:
    """Returns a duration in its two largest units, such as `3 d 4 h` or `12 min 5 s`."""
    seconds = round(seconds)
    units = ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s"))
    for size, unit, part, smaller in units:
        if seconds >= size:
            return f"{seconds // size} {unit} {seconds % size // part} {smaller}"
    return f"{seconds} s"


def with_results(command: str, results: Path) -> str:
    """Returns a command that a message suggests, with `--results` unless it is the default."""
    if results == Path(RESULTS):
        return command
    return f"{command} --results {shlex.quote(str(results))}"


def directory_name(path: Path) -> str:
    """Returns the name of a directory, also of `.` and `..`; that of results if it has none."""
    name = path.name
    if name in ("", ".."):
        name = path.resolve().name
    return name or RESULTS


def joined_clauses(*clauses: str) -> str:
    """Returns the clauses that are not empty, such as `undecided; no common step`."""
    return "; ".join(filter(None, clauses))


def in_matrix_file(keys: str, table: str = "") -> str:
    """Returns which keys of a matrix file do what the options of a message do, in parentheses."""
    of_table = f" of [{table}]" if table else ""
    return f"(in a matrix file, {keys}{of_table})"


def repair_hint(results: Path) -> str:
    """Returns the sentence on the commands for damaged records."""
    verify, repair = (with_results(f"jbench {verb}", results) for verb in ("verify", "repair"))
    return f"`{verify}` lists the problems, `{repair}` sets aside what is damaged."


def in_prose(names: Iterable[str], word: str = "or") -> str:
    """Returns at least one name as a list in prose: `a, b or c`."""
    *others, last = names
    if not others:
        return last
    return f"{', '.join(others)} {word} {last}"
