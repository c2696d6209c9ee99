"""The runs of a sweep while they go on: a table on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from jbench.commands.output import Output, duration, printable
from jbench.settings.run import RunSettings
from jbench.training.processes import Message
from jbench.training.train import resume_sentence

_PLAIN_EVERY = 60.0  # s between plain lines, where there is no terminal
_MOST_RETURNS = 6  # last returns in a line; of more seeds their mean and extremes


class _Batch:
    """What is known of runs that share a process."""

    def __init__(self, runs: Sequence[RunSettings]) -> None:
        self.runs = runs
        self.done = {run.id: 0 for run in runs}
        self.returns: dict[str, float] = {}
        self._total = sum(run.steps for run in runs)
        self._first: tuple[float, int] | None = None

    @property
    def name(self) -> str:
        """Names the cell and the seeds."""
        run, seeds = self.runs[0], ",".join(str(run.seed) for run in self.runs)
        return f"{run.task} {run.algo} {run.representation} seed {seeds}"

    @property
    def steps(self) -> int:
        """Control steps of all its runs."""
        return sum(self.done.values())

    @property
    def gained(self) -> int:
        """Those of them that were done since its first word."""
        return 0 if self._first is None else self.steps - self._first[1]

    def note(self, run: RunSettings, steps: int, goes_on: bool = False) -> None:
        """Notes how far a run is; one that goes on has not come there just now."""
        self.done[run.id] = min(steps, run.steps)
        if self._first is None or goes_on:
            self._first = time.monotonic(), self.steps

    def rate(self) -> float | None:
        """Returns the control steps of all its runs in a second, so far."""
        if self._first is None or not self.gained:
            return None
        return self.gained / (time.monotonic() - self._first[0])

    def cells(self) -> tuple[str, ...]:
        """Returns a line: name, steps, speed, last returns, time left."""
        rate = self.rate()
        return (
            self.name,
            f"{self.steps:,}/{self._total:,}",
            "" if rate is None else f"{rate:,.0f}",
            self._last_returns(),
            "" if rate is None else duration((self._total - self.steps) / rate),
        )

    def _last_returns(self) -> str:
        values = list(self.returns.values())
        if len(values) <= _MOST_RETURNS:
            return " ".join(f"{value:.0f}" for value in values)
        mean = sum(values) / len(values)
        return f"mean {mean:.0f} [{min(values):.0f}, {max(values):.0f}]"


class SweepView:
    """Shows the runs of a sweep: a table that is drawn again on a terminal, else plain lines."""

    def __init__(self, runs: Sequence[RunSettings], output: Output, live: bool) -> None:
        """Starts the clock.

        Args:
            runs: that are to be done.
            output: for sentences.
            live: whether a table is drawn.
        """
        self._output, self._live = output, live
        self._runs, self._ended = len(runs), set[str]()
        self._total = sum(run.steps for run in runs)
        self._done, self._gained = dict.fromkeys((run.id for run in runs), 0), 0
        self._batches: list[_Batch] = []
        self._began = self._printed = time.monotonic()

    def begins(self, runs: Sequence[RunSettings]) -> None:
        """Adds the line of a process."""
        self._batches.append(_Batch(runs))

    def says(self, run: RunSettings, message: Message) -> None:
        """Takes in what a process says."""
        ended = "finished" in message or "failed" in message
        # Of one that is left to another process, it is not the end.
        if ended and not message.get("held"):
            self._ended.add(run.id)
        steps = message.get("control_steps", message.get("goes_on_from"))
        if "finished" in message:
            steps = run.steps
        if steps is not None:
            self._done[run.id] = min(steps, run.steps)
        batch = next((each for each in self._batches if run.id in each.done), None)
        if batch is not None and steps is not None:
            batch.note(run, steps, goes_on="goes_on_from" in message)
            if message.get("episode_return") is not None:
                batch.returns[run.id] = message["episode_return"]
        if "goes_on_from" in message:
            self.note(resume_sentence(run, message))
        self._print_now_and_then()

    def ends(self, runs: Sequence[RunSettings]) -> None:
        """Takes the line of a process away."""
        ids = {run.id for run in runs}
        for batch in [each for each in self._batches if ids & each.done.keys()]:
            self._gained += batch.gained
            self._batches.remove(batch)
            if not self._live:
                name, steps, _, returns, _ = batch.cells()
                told = [f"{steps} control steps", *([f"last returns {returns}"] if returns else [])]
                print(f"{name}: {', '.join(told)}; {self._summary()}", file=sys.stderr, flush=True)

    def note(self, sentence: str) -> None:
        """Prints a sentence."""
        self._output.say(sentence)

    def __rich__(self) -> Table:
        """Returns the table of the moment."""
        table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
        for name, right in (
            *(("running", False), ("control steps", True), ("steps/s", True)),
            *(("last returns", False), ("left", True)),
        ):
            table.add_column(name, justify="right" if right else "left", overflow="fold")
        for batch in list(self._batches):
            table.add_row(*(Text(printable(cell)) for cell in batch.cells()))
        table.caption, table.caption_justify = Text(self._summary()), "left"
        return table

    def _summary(self) -> str:
        parts = [f"{len(self._ended)} of {self._runs} runs ended"]
        done = sum(self._done.values())
        gained = self._gained + sum(batch.gained for batch in self._batches)
        if gained and done < self._total:
            rate = gained / (time.monotonic() - self._began)
            left = duration((self._total - done) / rate)
            parts.append(f"{rate:,.0f} steps/s so far, {left} left at that pace")
        return ", ".join(parts)

    def _print_now_and_then(self) -> None:
        now = time.monotonic()
        if self._live or now - self._printed < _PLAIN_EVERY:
            return
        self._printed = now
        for batch in self._batches:
            name, steps, rate, returns, left = batch.cells()
            told = [f"{steps} control steps"]
            if rate:
                told += [f"{rate} steps/s", f"{left} left", f"last returns {returns}"]
            print(f"{name}: {', '.join(told)}", file=sys.stderr)
        print(self._summary(), file=sys.stderr, flush=True)


@contextmanager
def sweep_view(runs: Sequence[RunSettings], output: Output) -> Iterator[SweepView]:
    """Gives what shows the runs of a sweep while the block lasts, on standard error."""
    live = sys.stderr.isatty()
    view = SweepView(runs, output, live)
    if not live:
        yield view
        return
    with Live(
        view,
        console=Console(stderr=True),
        refresh_per_second=2,
        # Lines said meanwhile go above the table; but a pipe gets what is meant for it.
        redirect_stdout=sys.stdout.isatty(),
    ):
        yield view
