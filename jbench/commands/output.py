"""Terminal output of the commands: text, tables, progress, or one JSON document."""

import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ClassVar

from jbench.errors import WorkError
from jbench.json_text import json_text
from jbench.wording import are, counted, duration

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

_PLAIN_EVERY = 10.0  # s between plain lines of progress, where there is no terminal
_MAX_TERMINAL_LINES = 3  # of a row whose words don't fit side by side


@contextmanager
def _writing() -> Iterator[None]:
    """Turns OS errors of the streams into a WorkError; a broken pipe is left to the caller."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise WorkError(f"The output can't be written ({error.strerror}).") from None


class Output:
    """Standard output for people, or for a program, with everything else on standard error."""

    has_document: ClassVar[bool] = False
    """Whether the command has written to standard output with `raw`; reset before each command."""

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json

    def say(self, text: str) -> None:
        """Prints a line for people."""
        with _writing():
            print(printable(text), file=sys.stderr if self.as_json else sys.stdout, flush=True)

    def warn(self, text: str) -> None:
        """Prints a line about something wrong that does not end the work."""
        with _writing():
            print(f"Warning: {printable(text)}", file=sys.stderr, flush=True)

    def table(self, title: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Prints a table for people; no word is broken, and numbers are aligned to the right."""
        from rich.console import Console
        from rich.measure import Measurement
        from rich.text import Text

        # A pipe has no width but that of COLUMNS: use one that holds most tables.
        width = shutil.get_terminal_size((200, 24)).columns
        console = Console(file=sys.stderr if self.as_json else sys.stdout, width=width)
        cells = [[printable(str(cell)) for cell in row] for row in rows]
        table = _table(header, cells)
        widths = Measurement.get(console, console.options.update(max_width=10**6), table)
        if widths.minimum > width:
            if widths.maximum <= _MAX_TERMINAL_LINES * width or not cells:
                console.width = widths.maximum  # the terminal wraps the lines
            else:
                table = _table_of_cells(header, cells)
        with _writing():
            console.print(Text(title, style="bold"), soft_wrap=True)
            console.print(table)

    def frame(self, title: str, frame: "pd.DataFrame") -> None:
        """Prints a frame for people; numbers have six digits."""
        cells = frame.astype(object).where(frame.notna(), None).to_numpy()
        self.table(title, list(map(str, frame.columns)), [list(map(short, row)) for row in cells])

    def warn_of_damage(self, problems: Sequence[str], advice: str = "") -> None:
        """Prints a warning for each damaged record.

        Args:
            advice: last sentence of the error.

        Raises:
            WorkError: if there is any, after the warnings.
        """
        for problem in problems:
            self.warn(problem)
        if problems:
            count = f"{counted(len(problems), 'record')} {are(len(problems))}"
            raise WorkError(f"{count} damaged and left out; see above. {advice}".rstrip())

    def document(self, content: dict[str, Any]) -> None:
        """Prints the JSON document if `--json` was given; see `json_text`."""
        if self.as_json:
            self.raw(f"{json_text(content)}\n")

    def raw(self, text: str) -> None:
        """Writes text to standard output unchanged."""
        Output.has_document = True
        with _writing():
            print(text, end="", flush=True)

    @contextmanager
    def progress(
        self, what: str, total: int, unit: str, then: str = ""
    ) -> Iterator[Callable[[int], None]]:
        """Shows progress on standard error inside the `with` block; nothing if the total is 0.

        Args:
            then: what is done when the total is reached, before the block ends.

        Yields:
            A function that shows how much of the total is done.
        """
        if not total:
            yield lambda done: None
        elif sys.stderr.isatty():
            with _bar(what, total, then) as update:
                yield update
        else:
            yield _Lines(what, total, unit, then).update


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> "Table":
    """Returns a table whose columns are at least as wide as their longest word."""
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    table = Table(header_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for name, *column in zip(header, *rows, strict=True):
        words = [word for cell in (name, *column) for word in cell.split()]
        table.add_column(
            Text(name),
            justify="right" if all(map(_is_number, column)) else "left",
            min_width=max(map(cell_len, words), default=0),
            # Only columns of several words are narrowed.
            no_wrap=all(len(cell.split()) < 2 for cell in column),
        )
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _table_of_cells(header: Sequence[str], rows: Sequence[Sequence[str]]) -> "Table":
    """Returns a table of column names and cells, with a rule after each row of `rows`."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for row in rows:
        for name, cell in zip(header, row, strict=True):
            table.add_row(Text(name), Text(cell))
        table.add_section()
    return table


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "") or "0")
    except ValueError:
        return False
    return True


class _Lines:
    """A plain line every few seconds."""

    def __init__(self, what: str, total: int, unit: str, then: str) -> None:
        self._what, self._total, self._unit, self._then = what, total, unit, then
        self._first: tuple[float, int] | None = None
        self._printed, self._ended = time.monotonic(), False

    def update(self, done: int) -> None:
        now = time.monotonic()
        if self._first is None:
            self._first = (now, done)
        ended = done >= self._total and not self._ended
        if now - self._printed < _PLAIN_EVERY and not ended:
            return
        self._printed, self._ended = now, done >= self._total
        began, already = self._first
        rate = (done - already) / (now - began) if now > began else 0.0
        parts = [f"{done:,} of {self._total:,} {self._unit} ({done / self._total:.0%})"]
        if rate > 0 and done < self._total:
            speed = f"{rate:,.0f}" if rate >= 10 else f"{rate:.2g}"
            parts += [f"{speed}/s", f"{duration((self._total - done) / rate)} left"]
        elif self._then and done >= self._total:
            parts.append(f"now {self._then}")
        print(f"{self._what}: {', '.join(parts)}", file=sys.stderr, flush=True)


@contextmanager
def _bar(what: str, total: int, then: str) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal."""
    from rich import progress as rich

    columns = (
        rich.TextColumn("{task.description}", markup=False),
        rich.BarColumn(bar_width=16),
        rich.TextColumn("{task.completed:,.0f}/{task.total:,.0f}"),
        rich.TimeRemainingColumn(compact=True, elapsed_when_finished=True),
    )
    from rich.console import Console

    with rich.Progress(
        *columns,
        console=Console(stderr=True),
        speed_estimate_period=120,
        # Lines printed meanwhile appear above the bar, unless stdout is a pipe.
        redirect_stdout=sys.stdout.isatty(),
    ) as bars:
        task = bars.add_task(what, total=total)
        yield lambda done: bars.update(
            task, completed=done, description=then if then and done >= total else what
        )


def printable(text: str) -> str:
    """Strips control characters from untrusted text."""
    return "".join(c if c.isprintable() or c in "\n\t" else "\ufffd" for c in text)


def short(cell: object) -> str:
    """Formats a table cell: None as an empty string, floats that are not whole with six digits."""
    if cell is None:
        return ""
    if not isinstance(cell, float):
        return str(cell)
    return f"{cell:.0f}" if cell.is_integer() and abs(cell) < 1e15 else f"{cell:.6g}"
