"""Progress of long work: a live line for each part of it on a terminal, plain lines elsewhere."""

import itertools
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress import BarColumn, Progress, Task, TaskID
from rich.table import Column, Table
from rich.text import Text

from jbench.commands.cells import shortened
from jbench.commands.streams import writing
from jbench.wording import duration

_SPARKLINE = 16  # characters
_BARS = "▁▂▃▄▅▆▇█"
_BAR = 16  # characters
_SHORTEST_NAME = 12  # characters of a name on a narrow terminal

_PARTS = ("name", "bar", "done", "speed", "left", "curve", "returns", "published")
_GIVE_WAY = ("curve", "bar", "published", "speed", "left", "returns", "mean")
"""The parts of a live line, and those that a narrow terminal lacks, the least important one first.
In the place of the returns of several seeds is their mean."""


class Meters(Progress):
    """Shows on standard error how much of each task is done, its speed and the time left."""

    _plain_every = 10  # s between the lines that are printed without a terminal
    # Whether there is a single task, which has a bar, and a plain line when it is done.
    _alone = True

    def __init__(self) -> None:
        """Draws on standard error, and only on a terminal."""
        self._printed = time.monotonic()
        self._plain_lines = dict[TaskID, str]()
        super().__init__(
            console=Console(stderr=True),
            refresh_per_second=2,
            speed_estimate_period=600,
            # Lines printed meanwhile appear above the live ones, unless stdout is a pipe.
            redirect_stdout=sys.stdout.isatty(),
            disable=not sys.stderr.isatty(),
        )

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yields what is live."""
        yield _Lines(self.tasks, has_bar=self._alone)

    def show_done(self, id: TaskID, done: int, **fields: Any) -> None:
        """Shows how much of a task is done, with its description and other fields."""
        (task,) = (task for task in self.tasks if task.id == id)
        was_finished = task.finished
        self.update(id, completed=done, **fields)
        is_due = time.monotonic() - self._printed >= self._plain_every
        if is_due or (self._alone and task.finished and not was_finished):
            self.print_lines()

    def print_lines(self) -> None:
        """Prints a plain line for each task about which there is news, if there is no terminal."""
        self._printed = time.monotonic()
        if not self.disable:
            return

        for task in self.tasks:
            line = _plain_line(task)
            if self._plain_lines.get(task.id) != line:
                self._plain_lines[task.id] = line
                with writing():
                    print(line, file=sys.stderr, flush=True)


@dataclass
class _Lines:
    """A line for each task; on a narrow terminal it says less."""

    tasks: Sequence[Task]
    has_bar: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Draws the lines with as many of their parts as the terminal has room for."""
        width = options.max_width
        lines = [_line(task) for task in self.tasks]
        parts = [part for part in _PARTS if part != "bar" or self.has_bar]
        for part in _GIVE_WAY:
            if _width(lines, parts) <= width:
                break
            parts = [other for other in parts if other != part]
            if part == "returns":
                parts.append("mean")

        room = width - _width(lines, [part for part in parts if part != "name"])
        bar = BarColumn(bar_width=_BAR)
        table = Table.grid(*(Column(no_wrap=True) for _ in parts), padding=(0, 1, 0, 0))
        for task, line in zip(self.tasks, lines, strict=True):
            line["name"] = shortened(line["name"], max(room - 1, _SHORTEST_NAME))
            cells = {part: Text(text) for part, text in line.items()} | {"bar": bar(task)}
            table.add_row(*(cells[part] for part in parts))

        yield table


def _line(task: Task) -> dict[str, str]:
    """Returns the texts of a task by their parts of a line; in place of the bar is its room."""
    total = task.total or 0
    returns: LastReturns = task.fields.get("returns") or LastReturns()
    line = {
        "name": task.description,
        "bar": " " * _BAR,
        "done": f"{task.completed:,.0f} of {total:,.0f} {task.fields['unit']}",
        "speed": "",
        "left": "",
        **returns._asdict(),
    }
    is_over = task.finished or task.fields.get("has_ended", False)
    if is_over or task.fields.get("warming_up"):
        return line

    speed = task.speed
    left = task.time_remaining
    if speed is not None and left is not None:
        line["speed"] = _per_second(speed)
        line["left"] = f"{duration(left)} left"

    return line


def _plain_line(task: Task) -> str:
    """Returns the texts of a task that make sense without a terminal, in one line."""
    line = _line(task)
    learned = " ".join(filter(None, (line["curve"], line["returns"], line["published"])))
    texts = (line["done"], line["speed"], line["left"], learned)
    return f"{line['name']}: {', '.join(filter(None, texts))}"


def _per_second(speed: float) -> str:
    """Returns a speed as text."""
    if speed >= 10:
        return f"{speed:,.0f}/s"
    return f"{speed:.2g}/s"


def _width(lines: Sequence[dict[str, str]], parts: Sequence[str]) -> int:
    """Returns the characters of the longest line, whose name may be shortened."""
    widths = {part: max((cell_len(line[part]) for line in lines), default=0) for part in parts}
    if "name" in widths:
        widths["name"] = min(widths["name"], _SHORTEST_NAME)
    return sum(widths.values()) + len(parts)  # a space after each


class LastReturns(NamedTuple):
    """The texts on the newest returns of a process."""

    curve: str = ""
    returns: str = ""
    mean: str = ""
    published: str = ""


def sparkline(returns: Sequence[float], highest: float, lowest: float = 0.0) -> str:
    """Returns means of consecutive episode returns as bars, between two returns."""
    if len(returns) == 0:  # of a list or an array
        return ""

    span = (highest - lowest) or 1.0
    width = min(len(returns), _SPARKLINE)
    bounds = [len(returns) * i // width for i in range(width + 1)]
    means = [fmean(returns[first:last]) for first, last in itertools.pairwise(bounds)]
    levels = [round((mean - lowest) / span * (len(_BARS) - 1)) for mean in means]
    return "".join(_BARS[min(max(level, 0), len(_BARS) - 1)] for level in levels)
