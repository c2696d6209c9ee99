"""What is seen of a sweep while it trains: a live line for each process, and one for all runs."""

from collections.abc import Sequence
from functools import cache
from statistics import fmean
from typing import TYPE_CHECKING

from rich.progress import TaskID

from jbench.commands.progress import LastReturns, Meters, sparkline
from jbench.numbers import whole
from jbench.settings.run import RunSettings
from jbench.training.events import (
    EpisodeEnded,
    Finished,
    LastEvent,
    ProcessEnded,
    ProcessStarted,
    Progress,
    ProgressEvent,
    Resumed,
    RunEvent,
    TrainingBegan,
)
from jbench.wording import counted

if TYPE_CHECKING:
    import pandas as pd

_MAX_RETURNS = 6  # with more seeds, a line has the mean and extremes of their newest returns


class TrainingView(Meters):
    """Shows the events of a sweep: what is being made, and the processes that train."""

    _plain_every = 60
    _alone = False

    def __init__(self) -> None:
        """Shows nothing until the first event."""
        super().__init__()
        self._making: dict[str, TaskID] = {}
        self._processes: dict[str, _Process] = {}

    def show(self, event: ProgressEvent) -> None:
        """Draws an event of a sweep."""
        match event:
            case Progress():
                self._show_progress(event)
            case TrainingBegan():
                self._begin(event.runs)
            case ProcessStarted():
                self._add_process(event.runs)
            case ProcessEnded():
                self._remove_process(event.runs)
            case _:
                self._update(event)

    def _show_progress(self, event: Progress) -> None:
        """Draws the progress of some work before the training, in a line of its own."""
        if event.work not in self._making:
            task = self.add_task(event.work, total=event.total, unit=event.unit)
            self._making[event.work] = task
        self.show_done(self._making[event.work], event.done)

    def _begin(self, runs: Sequence[RunSettings]) -> None:
        """Draws a line of all runs in place of the work before."""
        for task in self._making.values():
            self.remove_task(task)
        self._runs = {run.id: run for run in runs}
        self._ended = set[str]()
        self._done = dict.fromkeys(self._runs, 0)
        count = self._count_ended()
        self._all = self.add_task(count, total=_steps(runs), unit="steps", warming_up=True)

    def _add_process(self, runs: Sequence[RunSettings]) -> None:
        """Draws a line of a process that trains runs."""
        process = _Process(runs)
        process.task = self.add_task(
            process.name, total=_steps(runs), unit="steps", warming_up=True
        )
        for run in runs:
            self._processes[run.id] = process

    def _remove_process(self, runs: Sequence[RunSettings]) -> None:
        """Removes the line of a process that has trained runs."""
        self.print_lines()
        self.remove_task(self._processes[runs[0].id].task)
        for run in runs:
            del self._processes[run.id]

    def _count_ended(self) -> str:
        """Returns how many runs have ended, in words."""
        return f"{len(self._ended)} of {counted(len(self._runs), 'run')} ended"

    def _update(self, event: RunEvent) -> None:
        """Draws what an event tells of one run."""
        run = self._runs[event.run]
        process = self._processes.get(event.run)
        if isinstance(event, LastEvent):
            self._ended.add(run.id)
        if isinstance(event, Finished):
            self._done[run.id] = run.last_step
        elif isinstance(event, Resumed | EpisodeEnded):
            self._done[run.id] = min(event.control_steps, run.last_step)
        if isinstance(event, Resumed):  # the speed is measured from here
            self.reset(self._all)

        self.update(
            self._all,
            completed=sum(self._done.values()),
            description=self._count_ended(),
            has_ended=len(self._ended) == len(self._runs),
        )
        if process is not None:
            if isinstance(event, Resumed):
                self.reset(process.task)
            done = sum(self._done[other.id] for other in process.runs)
            if process.warming_up and done >= process.warm_up:
                process.warming_up = False
                self.reset(process.task)  # the speed is measured from here
                self.reset(self._all)
                self.update(self._all, completed=sum(self._done.values()), warming_up=False)

            if isinstance(event, EpisodeEnded):
                process.returns[run.id] = event.episode_return
                process.curve.append(event.episode_return)
            self.show_done(
                process.task,
                done,
                returns=process.learned(done),
                warming_up=process.warming_up,
                has_ended=all(other.id in self._ended for other in process.runs),
            )


def _steps(runs: Sequence[RunSettings]) -> int:
    """Returns the control steps of all runs."""
    return sum(run.last_step for run in runs)


class _Process:
    """A process that trains runs, as a line of the progress shows it."""

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
        self.warm_up = sum(run.first_update for run in runs)
        self.warming_up = True
        self._alike = configurations == 1
        if not self._alike:
            self.name = f"{run.algo} {len(runs)} runs of {configurations} configurations"

    def learned(self, steps: int) -> LastReturns:
        """Returns a sparkline, the newest returns, and the published one at as many steps."""
        values = list(self.returns.values())
        if not values:
            return LastReturns()

        mean = whole(fmean(values))
        text = " ".join(whole(value) for value in values)
        if len(values) > _MAX_RETURNS:
            text = f"mean {mean} [{whole(min(values))}, {whole(max(values))}]"

        shown_mean = f"mean return {mean}"
        if len(values) == 1:
            shown_mean = f"return {mean}"

        lowest, highest = self._range
        return LastReturns(
            curve=sparkline(self.curve, highest, lowest),
            returns=f"episode return {text}",
            mean=shown_mean,
            published=self._published(steps / len(self.runs)),
        )

    def _published(self, control_steps: float) -> str:
        """Returns the paper's median return at a control step of each run, if it has one."""
        if not self._alike:
            return ""

        median = published_median(self.runs[0], control_steps)
        if median is None:
            return ""
        return f"(published {whole(median)})"

    @property
    def _range(self) -> tuple[float, float]:
        """The possible returns of the runs, or those of the curve where they are unknown."""
        run = self.runs[0]
        if run.specs and not run.specs.unit_rewards:
            return min(self.curve), max(self.curve)
        return 0.0, float(run.episode_steps)


def published_median(run: RunSettings, control_steps: float) -> float | None:
    """Returns the paper's median return at a control step, if it has a curve like the run."""
    from jbench.report.data.curves import best_median

    cell = (run.task, run.algo, run.representation)
    best = best_median(_published_curves(), cell, control_steps)
    if best is None:
        return None

    median, _ = best
    return median


@cache
def _published_curves() -> "pd.DataFrame":
    """Returns the paper's curves, which are read once."""
    from jbench.report.data.curves import read_published
    from jbench.store.tables import published_rows

    return read_published(published_rows())
