"""Live progress of training: a table of processes on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from rich import box
from rich.console import Console, ConsoleOptions, JustifyMethod
from rich.live import Live
from rich.table import Table
from rich.text import Text

from jbench.commands.live_batch import Batch
from jbench.commands.output import Output, duration, printable
from jbench.settings.run import RunSettings
from jbench.sweeps.cell_status import CellStatus, seconds_left
from jbench.sweeps.executors import Message
from jbench.sweeps.watcher import Watcher
from jbench.wording import counted

_COLUMNS = ("running", "steps", "steps/s", "learning curve", "training return", "left")
_NUMBERS, _WRAPPED = ("steps", "steps/s", "left"), ("running", "training return")
_LEAST_FIRST = ("learning curve", "steps/s", "left")
"""Columns that a narrow terminal leaves out, in this order."""
_GAP = 3  # characters between columns

_PLAIN_EVERY = 60.0  # s between plain lines if stderr is not a terminal


class TrainingView(Watcher):
    """Prints the events of a sweep, and shows its processes during training."""

    def __init__(self, output: Output) -> None:
        self._output, self._live = output, sys.stderr.isatty()
        self._reset([])

    def _reset(self, runs: Sequence[RunSettings]) -> None:
        self._runs, self._ended = len(runs), set[str]()
        self._total = sum(run.last_step for run in runs)
        self._done, self._gained = dict.fromkeys((run.id for run in runs), 0), 0
        self._batches: list[Batch] = []
        self._began = self._printed = time.monotonic()

    def note(self, sentence: str) -> None:
        """Prints a sentence."""
        self._output.say(sentence)

    def warn(self, sentence: str) -> None:
        """Prints a warning."""
        self._output.warn(sentence)

    def progress(
        self, label: str, total: int, unit: str
    ) -> AbstractContextManager[Callable[[int], None]]:
        """Shows the progress of a dataset or an encoder."""
        return self._output.progress(label, total, unit)

    def forecast(self, statuses: Sequence[CellStatus], jobs: int) -> None:
        """Prints the estimated time left."""
        seconds, steps = seconds_left(statuses, jobs), sum(each.steps_left for each in statuses)
        if not seconds:
            return
        runs = [run for each in statuses for run in each.cell.runs]
        hints = {
            "fewer --steps (such as 300000)": max(run.steps for run in runs) > 300_000,
            "fewer --seeds (such as 0-2)": len({run.seed for run in runs}) > 3,
        }
        fewer = ", or ".join(hint for hint, applies in hints.items() if applies)
        less = f" For less: {fewer}." if fewer and seconds > 600 else ""
        parts = [(each.evaluating, each.seconds_left or 0.0) for each in statuses]
        share = sum(part * time for part, time in parts) / sum(time for _, time in parts)
        most = (
            " (most of the time: fewer with --evaluate-episodes, or episodes of [evaluation] in a "
            "matrix)"
        )
        self._output.say(
            f"{counted(len(runs), 'run')} with {steps:,} control steps left at about "
            f"{steps / seconds:,.0f} steps/s, evaluations included{most if share > 0.5 else ''}, "
            f"{counted(jobs, 'process', 'processes')} at a time: about "
            f"{duration(seconds)}.{less}"
        )

    @contextmanager
    def training(self, runs: Sequence[RunSettings]) -> Iterator[None]:
        """Shows the processes of the runs on stderr inside the `with` block."""
        self._reset(runs)
        if not self._live:
            yield
            return
        with Live(
            self,
            console=Console(stderr=True),
            refresh_per_second=2,
            # Lines printed meanwhile appear above the table, unless stdout is a pipe.
            redirect_stdout=sys.stdout.isatty(),
        ):
            yield

    def started(self, runs: Sequence[RunSettings]) -> None:
        """Adds the row of a process."""
        self._batches.append(Batch(runs))

    def message(self, run: RunSettings, message: Message) -> None:
        """Shows the progress of a run."""
        if "finished" in message or "failed" in message:
            self._ended.add(run.id)
        steps = message.get("control_steps", message.get("resumed_at"))
        if "finished" in message:
            steps = run.last_step
        if steps is not None:
            self._done[run.id] = min(steps, run.last_step)
        batch = next((each for each in self._batches if run.id in each.done), None)
        if batch is not None and steps is not None:
            batch.update(run, steps, resumed="resumed_at" in message)
            if message.get("episode_return") is not None:
                batch.add_return(run, message["episode_return"])
        self._print_if_due()

    def ended(self, runs: Sequence[RunSettings]) -> None:
        """Removes the row of a process."""
        ids = {run.id for run in runs}
        for batch in [each for each in self._batches if ids & each.done.keys()]:
            self._gained += batch.gained
            self._batches.remove(batch)
            if not self._live:
                print(f"{_line(batch, ended=True)}; {self._summary()}", file=sys.stderr, flush=True)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        """Yields the table of the processes; a narrow terminal has fewer columns."""
        rows = [tuple(map(printable, batch.cells())) for batch in list(self._batches)]
        shown = list(range(len(_COLUMNS)))
        widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
        for least in _LEAST_FIRST:
            if sum(widths[i] + _GAP for i in shown) > options.max_width:
                shown.remove(_COLUMNS.index(least))
        table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
        for i in shown:
            wraps = _COLUMNS[i] in _WRAPPED
            justify: JustifyMethod = "right" if _COLUMNS[i] in _NUMBERS else "left"
            table.add_column(_COLUMNS[i], justify=justify, no_wrap=not wraps)
        for row in rows:
            table.add_row(*(Text(row[i]) for i in shown))
        table.caption, table.caption_justify = Text(self._summary()), "left"
        yield table

    def _summary(self) -> str:
        parts = [f"{len(self._ended)} of {counted(self._runs, 'run')} ended"]
        done = sum(self._done.values())
        gained = self._gained + sum(batch.gained for batch in self._batches)
        if gained and done < self._total:
            rate = gained / (time.monotonic() - self._began)
            left = duration((self._total - done) / rate)
            parts.append(f"{rate:,.0f} steps/s so far, {left} left at that pace")
        return ", ".join(parts)

    def _print_if_due(self) -> None:
        """Prints a line for each process every minute if stderr is not a terminal."""
        now = time.monotonic()
        if self._live or now - self._printed < _PLAIN_EVERY:
            return
        self._printed = now
        for batch in self._batches:
            print(_line(batch), file=sys.stderr)
        print(self._summary(), file=sys.stderr, flush=True)


def _line(batch: Batch, *, ended: bool = False) -> str:
    """Returns the row of a process as plain text; without its speed if it has ended."""
    name, steps, rate, _, returns, left = batch.cells()
    parts = [f"{steps} control steps"]
    if rate and not ended:
        parts += [f"{rate} steps/s", f"{left} left"]
    if returns:
        parts.append(f"training return {returns}")
    return f"{name}: {', '.join(parts)}"
