"""Progress of long work: a live line for each part of it on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, Task, TaskID
from rich.table import Column, Table
from rich.text import Text

from jbench.wording import duration


class Meters(Progress):
    """Shows on standard error how much of each task is done, its speed and the time left."""

    def __init__(self, plain_every: float = 10, alone: bool = True) -> None:
        """Shows nothing yet; without a terminal, it prints lines every `plain_every` seconds.

        If `alone`, a single task is shown, with a bar, and a plain line when it is done.
        """
        self._plain_every, self._alone, self._printed = plain_every, alone, time.monotonic()
        super().__init__(
            console=Console(stderr=True),
            refresh_per_second=2,
            speed_estimate_period=600,
            # Lines printed meanwhile appear above the live ones, unless stdout is a pipe.
            redirect_stdout=sys.stdout.isatty(),
            disable=not sys.stderr.isatty(),
        )

    def make_tasks_table(self, tasks: Iterable[Task]) -> Table:
        """Returns a row for each task, whose numbers are never cut."""
        bars = [BarColumn(bar_width=16)] if self._alone else []
        fixed = [Column(no_wrap=True) for _ in ("done", "speed")]
        table = Table.grid(*(Column() for _ in ("name", *bars)), *fixed, padding=(0, 1))
        for task in tasks:
            name, *cells = map(Text, _cells(task))
            table.add_row(name, *(bar(task) for bar in bars), *cells)
        return table

    def show_done(self, id: TaskID, done: int, **fields: Any) -> None:
        """Shows how much of a task is done, with its description and other fields."""
        (task,) = (task for task in self.tasks if task.id == id)
        was_finished = task.finished
        self.update(id, completed=done, **fields)
        is_due = time.monotonic() - self._printed >= self._plain_every
        if is_due or (self._alone and task.finished and not was_finished):
            self.print_lines()

    def print_lines(self) -> None:
        """Prints a plain line for each task if there is no terminal."""
        self._printed = time.monotonic()
        for name, *cells in map(_cells, self.tasks) if self.disable else ():
            print(f"{name}: {', '.join(filter(None, cells))}", file=sys.stderr, flush=True)


def _cells(task: Task) -> tuple[str, ...]:
    """Returns what is done, how much, how fast, the time left, and what else there is to say."""
    total, speed, left = task.total or 0, task.speed, task.time_remaining
    running = speed is not None and left is not None and not task.finished
    return (
        task.description,
        f"{task.completed:,.0f} of {total:,.0f} {task.fields['unit']}",
        (f"{speed:,.0f}/s" if speed >= 10 else f"{speed:.2g}/s") if speed and running else "",
        f"{duration(left)} left" if left and running else "",
        task.fields.get("more", ""),
    )
