"""Live progress of training: a table of processes on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Self

from rich import box
from rich.console import Console, ConsoleOptions, JustifyMethod
from rich.live import Live
from rich.table import Table
from rich.text import Text

from jbench.commands.live_batch import ProcessRow
from jbench.commands.output import Output, printable
from jbench.settings.run import RunSettings
from jbench.training.events import Event
from jbench.wording import counted, duration

_COLUMNS = ("running", "steps", "steps/s", "learning curve", "training return", "left")
_NUMBERS, _WRAPPED = ("steps", "steps/s", "left"), ("running", "training return")
_LEAST_FIRST = ("learning curve", "steps/s", "left")
"""Columns that a narrow terminal leaves out, in this order."""
_GAP = 3  # characters between columns

_PLAIN_EVERY = 60.0  # s between plain lines if stderr is not a terminal


class TrainingView:
    """Prints the events of a sweep, and shows its processes until it is closed."""

    def __init__(self, output: Output) -> None:
        self._output, self._live = output, sys.stderr.isatty()
        self._shown, self._making = ExitStack(), ""
        self._reset([])

    def _reset(self, runs: Sequence[RunSettings]) -> None:
        self._runs, self._ended = {run.id: run for run in runs}, set[str]()
        self._total = sum(run.last_step for run in runs)
        self._done, self._gained = dict.fromkeys((run.id for run in runs), 0), 0
        self._batches: list[ProcessRow] = []
        self._began = self._printed = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._shown.close()

    def show(self, event: Event) -> None:
        """Shows an event of a sweep."""
        if event.kind == "note":
            self._output.say(event.text)
        elif event.kind == "warning":
            self._output.warn(event.text)
        elif event.kind == "progress":
            self._show_progress(event)
        elif event.kind == "training":
            self._show_training(event.runs)
        elif event.kind == "started":
            self._batches.append(ProcessRow(event.runs))
        elif event.kind == "ended":
            self._remove_batches({run.id for run in event.runs})
        else:
            self._update(event)

    def _show_progress(self, event: Event) -> None:
        """Shows how much of a dataset or an encoder is made."""
        if event.text != self._making or event.steps == 0:
            self._shown.close()
            bar = self._output.progress(event.text, event.total, event.unit)
            self._making, self._progress = event.text, self._shown.enter_context(bar)
        self._progress(event.steps)

    def _show_training(self, runs: Sequence[RunSettings]) -> None:
        """Shows the processes of the runs on stderr until the view is closed."""
        self._shown.close()
        self._reset(runs)
        if self._live:
            live = Live(
                self,
                console=Console(stderr=True),
                refresh_per_second=2,
                # Lines printed meanwhile appear above the table, unless stdout is a pipe.
                redirect_stdout=sys.stdout.isatty(),
            )
            self._shown.enter_context(live)

    def _update(self, event: Event) -> None:
        """Shows the progress of a run."""
        run, steps = self._runs[event.run], event.steps
        if event.kind == "finished":
            steps = run.last_step
        if event.is_last:
            self._ended.add(run.id)
        if event.kind != "failed":
            self._done[run.id] = min(steps, run.last_step)
            batch = next((batch for batch in self._batches if run.id in batch.done), None)
            if batch is not None:
                batch.update(run, steps, resumed=event.kind == "resumed")
                if event.kind == "episode":
                    batch.add_return(run, event.episode_return)
        self._print_if_due()

    def _remove_batches(self, ids: set[str]) -> None:
        """Removes the row of a process that has ended."""
        for batch in [batch for batch in self._batches if ids & batch.done.keys()]:
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
        parts = [f"{len(self._ended)} of {counted(len(self._runs), 'run')} ended"]
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


def _line(batch: ProcessRow, *, ended: bool = False) -> str:
    """Returns the row of a process as plain text; without its speed if it has ended."""
    name, steps, rate, _, returns, left = batch.cells()
    parts = [f"{steps} control steps"]
    if rate and not ended:
        parts += [f"{rate} steps/s", f"{left} left"]
    if returns:
        parts.append(f"training return {returns}")
    return f"{name}: {', '.join(parts)}"
