"""The terminal: text, tables and progress for people, or one JSON document for a program."""

import re
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from jbench.errors import WorkError
from jbench.wording import are, counted, json_text

if TYPE_CHECKING:
    import pandas as pd

    from jbench.store import Record
    from jbench.tasks.task import Task

_MAX_TERMINAL_LINES = 3  # of a row whose words don't fit side by side
_NUMBER = re.compile(r"[-+]?[\d,.]+(e[-+]?\d+)?|nan|[-+]?inf|")

DOCUMENT_VERSION = 1
"""Of the form of all documents; see `documents.py`."""

is_json = False
"""Whether `--json` was typed, so that what people read is printed to standard error."""

has_document = False
"""Whether the command has written to standard output with `raw`."""


def note_task(task: "Task") -> None:
    """Prints what users should know of a task."""
    for note in task.notes:
        warn(f"{task.name}: {note}.")


@contextmanager
def _writing() -> Iterator[None]:
    """Turns OS errors of the streams into a WorkError; a broken pipe is left to the caller."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise WorkError(f"The output can't be written ({error.strerror}).") from None


@_writing()
def say(text: str) -> None:
    """Prints a line for people."""
    print(printable(text), file=sys.stderr if is_json else sys.stdout, flush=True)


@_writing()
def warn(text: str) -> None:
    """Prints a line about something wrong that does not end the work."""
    print(f"Warning: {printable(text)}", file=sys.stderr, flush=True)


@_writing()
def table(title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Prints a table for people; no word is broken, and numbers are aligned to the right.

    A cell that is None is empty, and floats that are not whole have six digits.
    """
    from rich import box
    from rich.cells import cell_len
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    # A pipe has no width but that of COLUMNS: use one that holds most tables.
    width = shutil.get_terminal_size((200, 24)).columns
    console = Console(file=sys.stderr if is_json else sys.stdout, width=width)
    cells = [[printable(_short(cell)) for cell in row] for row in rows]
    grid = Table(header_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for name, *column in zip(header, *cells, strict=True):
        grid.add_column(
            Text(name),
            justify="right" if all(map(_NUMBER.fullmatch, column)) else "left",
            min_width=max(map(cell_len, " ".join((name, *column)).split()), default=0),
            # Only columns of several words are narrowed.
            no_wrap=all(len(cell.split()) < 2 for cell in column),
        )
    for row in cells:
        grid.add_row(*map(Text, row))
    widths = Measurement.get(console, console.options.update(max_width=10**6), grid)
    if widths.minimum > width:
        if widths.maximum <= _MAX_TERMINAL_LINES * width or not cells:
            console.width = widths.maximum  # the terminal wraps the lines
        else:
            grid = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
            grid.add_column(no_wrap=True, style="bold")
            grid.add_column(overflow="fold")
            for row in cells:
                for pair in zip(header, row, strict=True):
                    grid.add_row(*map(Text, pair))
                grid.add_section()
    console.print(Text(title, style="bold"), soft_wrap=True)
    console.print(grid)


def frame(title: str, frame: "pd.DataFrame") -> None:
    """Prints a frame for people."""
    cells = frame.astype(object).where(frame.notna(), None)
    table(title, list(map(str, frame.columns)), cells.to_numpy())


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


@_writing()
def raw(text: str) -> None:
    """Writes text to standard output unchanged."""
    global has_document
    has_document = True
    print(text, end="", flush=True)


@contextmanager
def progress(what: str, total: int, unit: str, then: str = "") -> Iterator[Callable[[int], None]]:
    """Shows progress on standard error inside the `with` block; nothing if the total is 0.

    Yields a function that shows how much is done. `then` is what is done after that, before the
    block ends.
    """
    if not total:
        yield lambda done: None
        return
    from jbench.commands.progress import Meters

    with Meters() as meters:
        task = meters.add_task(what, total=total, unit=unit)
        yield lambda done: meters.show_done(
            task, done, description=f"{what}, {then}" if then and done >= total else what
        )


def printable(text: str) -> str:
    """Strips control characters from untrusted text."""
    return "".join(c if c.isprintable() or c in "\n\t" else "\ufffd" for c in text)


def _short(cell: object) -> str:
    if not isinstance(cell, float):
        return "" if cell is None else str(cell)
    return f"{cell:.0f}" if cell.is_integer() and abs(cell) < 1e15 else f"{cell:.6g}"


def tally(words: Iterable[str]) -> str:
    """Returns the count of each word, such as `3 damaged, 1 leftover`."""
    return ", ".join(f"{count:,} {word}" for word, count in Counter(words).items())


def described(record: "Record", **more: Any) -> dict[str, Any]:
    """Returns the entry of a record in a command's JSON document."""
    entry = {"id": record.id, "path": record.path, "settings": record.settings}
    return {**entry, "summary": record.manifest.summary, **more}
