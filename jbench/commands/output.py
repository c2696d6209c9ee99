"""The terminal: text, tables and progress for people, or one JSON document for a program."""

import json
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from functools import partial
from typing import TYPE_CHECKING, Any, TextIO

from jbench import wording
from jbench.commands.streams import writing
from jbench.errors import RequestError, WorkError
from jbench.wording import are, counted

if TYPE_CHECKING:
    import pandas as pd

    from jbench.store import Record
    from jbench.tasks.task import Task

DOCUMENT_VERSION = 1
"""Of the form of all documents; see `documents.py`."""

is_json = False
"""Whether `--json` was typed, so that what people read is printed to standard error."""

has_document = False
"""Whether the command has written to standard output with `raw`."""

typed: Sequence[str] = ()
"""The arguments of the command, as they were typed."""

_documents: TextIO | None = None
"""Standard output while `documents_alone` keeps it for the document; None at other times."""

_warned = set[str]()
"""The warnings that the command has printed by `warn_once`."""

_kept: Callable[[], str] = str
"""Returns what is kept if the command is stopped now; nothing, until the command says it."""


def begin(arguments: Sequence[str]) -> None:
    """Sets what this module knows of a command that begins."""
    global is_json, has_document, typed, _kept
    typed = arguments
    is_json = "--json" in arguments
    has_document = False
    _warned.clear()
    _kept = str


@contextmanager
def documents_alone() -> Iterator[None]:
    """With `--json`, keeps standard output for the document inside the `with` block.

    Whatever else prints there, such as a user's environment, prints to standard error.
    """
    global _documents
    if not is_json or "--help" in typed:
        yield
        return

    _documents = sys.stdout
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _documents = None


def if_stopped(sentence: Callable[[], str] | str) -> None:
    """Sets what Ctrl-C prints from now on: what the command has kept, and how it goes on."""
    global _kept
    if isinstance(sentence, str):
        _kept = partial(str, sentence)
    else:
        _kept = sentence


def say_stopped() -> None:
    """Prints that Ctrl-C has ended the command, and what is kept."""
    try:
        kept = _kept()
    except (OSError, RequestError, WorkError):  # the results can't be read
        kept = ""
    print(printable(f"Stopped. {kept}".rstrip()), file=sys.stderr, flush=True)


def note_task(task: "Task") -> None:
    """Prints what users should know of a task."""
    for note in task.notes:
        warn(f"{task.name}: {note}.")


def _for_people() -> TextIO:
    """Returns the stream of what people read: with `--json`, not that of the document."""
    if is_json:
        return sys.stderr
    return sys.stdout


@writing()
def say(text: str) -> None:
    """Prints a line for people."""
    print(printable(text), file=_for_people(), flush=True)


@writing()
def warn(text: str) -> None:
    """Prints a line about something wrong that does not end the work."""
    print(f"Warning: {printable(text)}", file=sys.stderr, flush=True)


def warn_once(text: str) -> None:
    """Prints a warning, unless the command has printed the same one before."""
    if text not in _warned:
        _warned.add(text)
        warn(text)


@writing()
def table(
    title: str,
    header: Sequence[str],
    rows: Iterable[Sequence[object]],
    spare: Sequence[str] = (),
    below: Sequence[str] = (),
) -> None:
    """Prints a table for people, within the width of the terminal; see `jbench.commands.tables`.

    A cell that is None is empty, and floats that are not whole have six digits.

    Args:
        title: printed above the table.
        header: names of the columns.
        rows: the cells of each row.
        spare: columns that a narrow terminal may leave out, the least important one first.
        below: columns of long texts that it may show as lines under the table.
    """
    from rich.console import Console

    from jbench.commands.tables import print_table

    stream = _for_people()
    cells = [[printable(_short(cell)).replace("\t", " ") for cell in row] for row in rows]
    print_table(Console(file=stream), title, header, cells, width(stream), spare, below)


def width(stream: TextIO) -> int | None:
    """Returns the characters in a line of a stream, or None in a pipe: COLUMNS, if it is set."""
    typed = os.environ.get("COLUMNS", "")
    if typed.isdecimal() and int(typed) > 0:
        return int(typed)
    try:
        return os.get_terminal_size(stream.fileno()).columns or None
    except (OSError, ValueError):  # no terminal, or a stream of a test without a file
        return None


def frame(title: str, frame: "pd.DataFrame", spare: Sequence[str] = ()) -> None:
    """Prints a frame for people; see `table`."""
    cells = frame.astype(object).where(frame.notna(), None)
    table(title, list(map(str, frame.columns)), cells.to_numpy(), spare)


def warn_of_damage(problems: Sequence[str], advice: str = "") -> None:
    """Prints a warning for each damaged record, and then raises a WorkError with advice."""
    for problem in problems:
        warn(problem)
    if problems:
        count = f"{counted(len(problems), 'record')} {are(len(problems))}"
        raise WorkError(f"{count} left out; see above. {advice}".rstrip())


def document(content: dict[str, Any]) -> None:
    """Prints the JSON document if `--json` was typed; see `documents.py` and `json_text`."""
    if is_json:
        raw(f"{json_text({'version': DOCUMENT_VERSION, **content})}\n")


def json_text(value: Any) -> str:
    """Returns indented JSON with lists for arrays, null for NaN, and texts for other types."""
    return json.dumps(_plain(value), indent=1, allow_nan=False)


def _plain(value: Any) -> Any:
    """Returns a value as JSON has it; numbers that are not finite are null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, str | int | float):
        return value

    return str(value)


@writing()
def raw(text: str) -> None:
    """Writes text to standard output unchanged."""
    global has_document
    has_document = True
    print(text, end="", file=_documents or sys.stdout, flush=True)


@contextmanager
def progress(
    work: str, total: int, unit: str, last_work: str = ""
) -> Iterator[Callable[[int], None]]:
    """Shows progress on standard error inside the `with` block; nothing if the total is 0.

    Yields a function that shows how much is done.

    Args:
        work: what is done.
        total: all that there is to do, in units.
        unit: its plural.
        last_work: what is done after that, before the block ends.
    """
    if not total:
        yield lambda done: None
        return

    from jbench.commands.progress import Meters

    with Meters() as meters:
        task = meters.add_task(work, total=total, unit=unit)

        def show_done(done: int) -> None:
            description = work
            if last_work and done >= total:
                description = f"{work}, {last_work}"
            meters.show_done(task, done, description=description)

        yield show_done


def printable(text: str) -> str:
    """Strips control characters from untrusted text."""
    return wording.printable(text, keeping="\n\t")


def _short(cell: object) -> str:
    """Returns a cell as text, numbers with six digits."""
    if cell is None:
        return ""
    if not isinstance(cell, float):
        return str(cell)
    if cell.is_integer() and abs(cell) < 1e15:
        return f"{cell:.0f}"

    return f"{cell:.6g}"


def tally(words: Iterable[str]) -> str:
    """Returns the count of each word, such as `3 damaged, 1 leftover`."""
    return ", ".join(f"{count:,} {word}" for word, count in Counter(words).items())


def described(record: "Record", **more: Any) -> dict[str, Any]:
    """Returns the entry of a record in a command's JSON document."""
    entry = {"id": record.id, "path": record.path, "settings": record.settings}
    return {**entry, "summary": record.manifest.summary, **more}
