"""Progress of a sweep: what is being made, and the processes that train."""

import itertools
from collections.abc import Sequence
from functools import cache
from statistics import fmean
from typing import TYPE_CHECKING

from rich.progress import TaskID

from jbench.commands.meters import Meters
from jbench.commands.output import Output
from jbench.names import EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.training.events import Event
from jbench.wording import counted

if TYPE_CHECKING:
    import pandas as pd

_MAX_RETURNS = 6  # with more seeds, a line has the mean and extremes of their newest returns
_SPARKLINE = 16  # characters
_BARS = "▁▂▃▄▅▆▇█"


class TrainingView(Meters):
    """Shows the events of a sweep: sentences, what is being made, and processes that train."""

    def __init__(self, output: Output) -> None:
        super().__init__(plain_every=60, alone=False)
        self._output = output
        self._making: dict[str, TaskID] = {}
        self._processes: dict[str, _Process] = {}

    def show(self, event: Event) -> None:
        """Shows an event of a sweep."""
        if event.kind == "note":
            self._output.say(event.text)
        elif event.kind == "warning":
            self._output.warn(event.text)
        elif event.kind == "progress":
            if event.text not in self._making:
                task = self.add_task(event.text, total=event.total, unit=event.unit)
                self._making[event.text] = task
            self.show_done(self._making[event.text], event.steps)
        elif event.kind == "training":
            for task in self._making.values():
                self.remove_task(task)
            self._runs, self._ended = {run.id: run for run in event.runs}, set[str]()
            self._done = dict.fromkeys(self._runs, 0)
            steps = sum(run.last_step for run in event.runs)
            self._all = self.add_task(self._count_ended(), total=steps, unit="steps")
        elif event.kind == "started":
            process = _Process(event.runs)
            steps = sum(run.last_step for run in event.runs)
            process.task = self.add_task(process.name, total=steps, unit="steps")
            self._processes |= {run.id: process for run in event.runs}
        elif event.kind == "ended":
            self.print_lines()
            self.remove_task(self._processes[event.runs[0].id].task)
            for run in event.runs:
                del self._processes[run.id]
        else:
            self._update(event)

    def _count_ended(self) -> str:
        return f"{len(self._ended)} of {counted(len(self._runs), 'run')} ended"

    def _update(self, event: Event) -> None:
        run, process = self._runs[event.run], self._processes.get(event.run)
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
            if event.kind == "episode":
                process.returns[run.id] = event.episode_return
                process.curve.append(event.episode_return)
            done = sum(self._done[other.id] for other in process.runs)
            self.show_done(process.task, done, more=process.learned(done))


class _Process:
    task: TaskID

    def __init__(self, runs: Sequence[RunSettings]) -> None:
        self.runs, self.returns, self.curve = runs, dict[str, float](), list[float]()
        self._configurations = len({(run.task, run.representation) for run in runs})

    @property
    def name(self) -> str:
        """The configuration and the seeds, or the number of configurations."""
        run, seeds = self.runs[0], ",".join(str(run.seed) for run in self.runs)
        if self._configurations > 1:
            return f"{run.algo} {len(self.runs)} runs of {self._configurations} configurations"
        return f"{run.task} {run.algo} {run.representation} seed {seeds}"

    def learned(self, steps: int) -> str:
        """Returns a sparkline, the newest returns, and the published one at as many steps."""
        values = list(self.returns.values())
        if not values:
            return ""
        text = " ".join(f"{value:.0f}" for value in values)
        if len(values) > _MAX_RETURNS:
            text = f"mean {fmean(values):.0f} [{min(values):.0f}, {max(values):.0f}]"
        same = self._configurations == 1
        published = published_median(self.runs[0], steps / len(self.runs)) if same else None
        ending = "" if published is None else f" (published {published:.0f})"
        return f"{sparkline(self.curve)} training return {text}{ending}"


def sparkline(returns: Sequence[float]) -> str:
    """Returns means of consecutive episode returns as bars; a full bar is the highest return."""
    width = min(len(returns), _SPARKLINE)
    bounds = [len(returns) * i // width for i in range(width + 1)] if width else []
    means = [fmean(returns[first:last]) for first, last in itertools.pairwise(bounds)]
    levels = [round(mean / EPISODE_STEPS * (len(_BARS) - 1)) for mean in means]
    return "".join(_BARS[min(max(level, 0), len(_BARS) - 1)] for level in levels)


def published_median(run: RunSettings, control_steps: float) -> float | None:
    """Returns the paper's median return at a control step, if it has a curve like the run."""
    from jbench.report.data.published import best_median

    cell = run.task, run.algo, run.representation
    best = best_median(_published_curves(), cell, control_steps)
    return None if best is None else best[0]


@cache
def _published_curves() -> "pd.DataFrame":
    from jbench.report.data.published import read_published
    from jbench.store import query

    return read_published(query.published())
