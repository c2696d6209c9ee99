"""Progress of long work: a live line for each part of it on a terminal, plain lines elsewhere."""

import itertools
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from statistics import fmean
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress import BarColumn, Progress, Task, TaskID
from rich.table import Column, Table
from rich.text import Text

from jbench.commands.tables import shortened
from jbench.settings.run import RunSettings
from jbench.training.events import Event
from jbench.wording import counted, duration

if TYPE_CHECKING:
    import pandas as pd

_MAX_RETURNS = 6  # with more seeds, a line has the mean and extremes of their newest returns
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
        """Prints a plain line for each task if there is no terminal."""
        self._printed = time.monotonic()
        for line in map(_line, self.tasks) if self.disable else ():
            learned = " ".join(filter(None, (line["curve"], line["returns"], line["published"])))
            texts = (line["done"], line["speed"], line["left"], learned)
            print(f"{line['name']}: {', '.join(filter(None, texts))}", file=sys.stderr, flush=True)


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
            instead = ["mean"] if part == "returns" else []
            parts = [*(other for other in parts if other != part), *instead]

        room = width - _width(lines, [part for part in parts if part != "name"])
        bar = BarColumn(bar_width=_BAR)
        table = Table.grid(*(Column(no_wrap=True) for _ in parts), padding=(0, 1, 0, 0))
        for task, line in zip(self.tasks, lines, strict=True):
            line["name"] = shortened(line["name"], max(room - 1, _SHORTEST_NAME))
            table.add_row(*(bar(task) if part == "bar" else Text(line[part]) for part in parts))

        yield table


def _line(task: Task) -> dict[str, str]:
    """Returns the texts of a task by their parts of a line."""
    total = task.total or 0
    speed = task.speed
    left = task.time_remaining
    is_measured = speed is not None and left is not None
    running = is_measured and not task.finished and not task.fields.get("warming_up")
    returns: LastReturns = task.fields.get("returns") or LastReturns()
    return {
        "name": task.description,
        "done": f"{task.completed:,.0f} of {total:,.0f} {task.fields['unit']}",
        "speed": _per_second(speed) if speed and running else "",
        "left": f"{duration(left)} left" if left and running else "",
        **returns._asdict(),
    }


def _per_second(speed: float) -> str:
    """Returns a speed as text."""
    return f"{speed:,.0f}/s" if speed >= 10 else f"{speed:.2g}/s"


def _width(lines: Sequence[dict[str, str]], parts: Sequence[str]) -> int:
    """Returns the characters of the longest line, whose name may be shortened."""
    width = len(parts)  # a space after each
    for part in parts:
        longest = (
            _BAR if part == "bar" else max((cell_len(line[part]) for line in lines), default=0)
        )
        width += min(longest, _SHORTEST_NAME) if part == "name" else longest
    return width


class LastReturns(NamedTuple):
    """The texts on the newest returns of a process."""

    curve: str = ""
    returns: str = ""
    mean: str = ""
    published: str = ""


class TrainingView(Meters):
    """Shows the events of a sweep: what is being made, and the processes that train."""

    _plain_every = 60
    _alone = False

    def __init__(self) -> None:
        """Shows nothing until the first event."""
        super().__init__()
        self._making: dict[str, TaskID] = {}
        self._processes: dict[str, _Process] = {}

    def show(self, event: Event) -> None:
        """Shows an event of a sweep that is no sentence."""
        steps = sum(run.last_step for run in event.runs)
        if event.kind == "progress":
            if event.text not in self._making:
                task = self.add_task(event.text, total=event.total, unit=event.unit)
                self._making[event.text] = task
            self.show_done(self._making[event.text], event.steps)
        elif event.kind == "training":
            for task in self._making.values():
                self.remove_task(task)
            self._runs = {run.id: run for run in event.runs}
            self._ended = set[str]()
            self._done = dict.fromkeys(self._runs, 0)
            count = self._count_ended()
            self._all = self.add_task(count, total=steps, unit="steps", warming_up=True)
        elif event.kind == "started":
            process = _Process(event.runs)
            process.task = self.add_task(process.name, total=steps, unit="steps", warming_up=True)
            for run in event.runs:
                self._processes[run.id] = process
        elif event.kind == "ended":
            self.print_lines()
            self.remove_task(self._processes[event.runs[0].id].task)
            for run in event.runs:
                del self._processes[run.id]
        else:
            self._update(event)

    def _count_ended(self) -> str:
        """Returns how many runs have ended, in words."""
        return f"{len(self._ended)} of {counted(len(self._runs), 'run')} ended"

    def _update(self, event: Event) -> None:
        """Draws what an event tells of one run."""
        run = self._runs[event.run]
        process = self._processes.get(event.run)
        if event.is_last:
            self._ended.add(run.id)
        if event.kind != "failed":
            steps = run.last_step if event.kind == "finished" else event.steps
            self._done[run.id] = min(steps, run.last_step)
        if event.kind == "resumed":  # the speed is measured from here
            self.reset(self._all)

        self.update(self._all, completed=sum(self._done.values()), description=self._count_ended())
        if process is not None:
            if event.kind == "resumed":
                self.reset(process.task)
            done = sum(self._done[other.id] for other in process.runs)
            if process.warming_up and done >= process.warm_up:
                process.warming_up = False
                self.reset(process.task)  # the speed is measured from here
                self.reset(self._all)
                self.update(self._all, completed=sum(self._done.values()), warming_up=False)

            if event.kind == "episode":
                process.returns[run.id] = event.episode_return
                process.curve.append(event.episode_return)
            self.show_done(
                process.task, done, returns=process.learned(done), warming_up=process.warming_up
            )


class _Process:
    task: TaskID

    def __init__(self, runs: Sequence[RunSettings]) -> None:
        """Has a line of its own, for the runs that are trained together."""
        self.runs = runs
        self.returns = dict[str, float]()
        self.curve = list[float]()
        run = runs[0]
        seeds = ",".join(str(run.seed) for run in runs)
        self.name = f"{run.task} {run.algo} {run.representation} seed {seeds}"
        configurations = len({(run.task, run.representation) for run in runs})
        # The control steps before the first updates are fast and tell nothing of the time left.
        self.warm_up = sum(run.algorithm.first_update for run in runs)
        self.warming_up = True
        self._alike = configurations == 1
        if not self._alike:
            self.name = f"{run.algo} {len(runs)} runs of {configurations} configurations"

    def learned(self, steps: int) -> LastReturns:
        """Returns a sparkline, the newest returns, and the published one at as many steps."""
        values = list(self.returns.values())
        if not values:
            return LastReturns()

        mean = f"{fmean(values):.0f}"
        text = " ".join(f"{value:.0f}" for value in values)
        if len(values) > _MAX_RETURNS:
            text = f"mean {mean} [{min(values):.0f}, {max(values):.0f}]"

        at = steps / len(self.runs)
        published = published_median(self.runs[0], at) if self._alike else None
        lowest, highest = self._range

        return LastReturns(
            sparkline(self.curve, highest, lowest),
            f"training return {text}",
            f"return {mean}" if len(values) == 1 else f"mean return {mean}",
            "" if published is None else f"(published {published:.0f})",
        )

    @property
    def _range(self) -> tuple[float, float]:
        """The possible returns of the runs, or those of the curve where they are unknown."""
        run = self.runs[0]
        if run.specs and not run.specs.unit_rewards:
            return min(self.curve), max(self.curve)
        return 0.0, float(run.episode_steps)


def sparkline(returns: Sequence[float], highest: float, lowest: float = 0.0) -> str:
    """Returns means of consecutive episode returns as bars, between two returns."""
    span = (highest - lowest) or 1.0
    width = min(len(returns), _SPARKLINE)
    bounds = [len(returns) * i // width for i in range(width + 1)] if width else []
    means = [fmean(returns[first:last]) for first, last in itertools.pairwise(bounds)]
    levels = [round((mean - lowest) / span * (len(_BARS) - 1)) for mean in means]
    return "".join(_BARS[min(max(level, 0), len(_BARS) - 1)] for level in levels)


def published_median(run: RunSettings, control_steps: float) -> float | None:
    """Returns the paper's median return at a control step, if it has a curve like the run."""
    from jbench.report.data.curves import best_median

    cell = run.task, run.algo, run.representation
    best = best_median(_published_curves(), cell, control_steps)
    return None if best is None else best[0]


@cache
def _published_curves() -> "pd.DataFrame":
    """Returns the paper's curves, which are read once."""
    from jbench.report.data.curves import read_published
    from jbench.store import query

    return read_published(query.published())
