"""Status of the cells of a matrix, and the time that what is left of them takes."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from jbench.store import Results
from jbench.sweeps.cell import Cell
from jbench.sweeps.step_times import StepTimes
from jbench.training.status import run_status


class CellStatus(NamedTuple):
    """Numbers of seeds of a cell by status, and what is left of all its runs.

    Attributes:
        steps_left: control steps.
        seconds_left: s on this machine; None if unknown.
        estimate: source of `seconds_left`, see `StepTime`; empty if nothing is left.
        evaluating: share of the time that evaluations take; 0 if they have fewer control steps
            than the training, and so take at most half of the time.
        failing_again: number of failed runs that are not trained, since they would fail again.
    """

    cell: Cell
    finished: int
    unfinished: int
    failed: int
    missing: int
    steps_left: int
    seconds_left: float | None
    estimate: str
    evaluating: float = 0.0
    failing_again: int = 0

    @property
    def runs_left(self) -> int:
        """Number of runs that are to be trained."""
        return len(self.cell.runs) - self.finished - self.failing_again


def cell_statuses(
    cells: Sequence[Cell],
    results: Results,
    jobs: int,
    device: str = "cpu",
    quick: bool = True,
    final_episodes: int | None = None,
) -> list[CellStatus]:
    """Returns the status of each cell, with the estimated time left on this machine.

    If `quick`, the speed is measured here, which takes seconds for each algorithm. Where it can't
    be, it is that of similar finished runs in the results. `jobs` is the number of processes at a
    time, `device` that of the batched engine, and `final_episodes` the number of episodes of last
    evaluations, if the user typed it.
    """
    times = StepTimes(results, jobs, device, final_episodes, measures=quick)
    all_statuses = []
    for cell in cells:
        statuses = [run_status(run, results, device) for run in cell.runs]
        states = [status.state for status in statuses]
        waiting = [
            (run, status.steps_left)
            for run, status in zip(cell.runs, statuses, strict=True)
            if status.state != "finished" and not status.fails_again
        ]
        runs = [run for run, _ in waiting]
        left = sum(steps for _, steps in waiting)

        first = cell.runs[0]
        step_time = times.of(first, runs if left else ())
        seconds = step_time.seconds
        evaluating = 0.0
        if left and seconds:
            evaluating = times.evaluating_share(first, seconds)

        all_statuses.append(
            CellStatus(
                cell,
                finished=states.count("finished"),
                unfinished=states.count("unfinished"),
                failed=states.count("failed"),
                missing=states.count("missing"),
                steps_left=left,
                seconds_left=None if seconds is None else left * seconds / _busy(len(runs), jobs),
                estimate=step_time.source if left else "",
                evaluating=evaluating,
                failing_again=sum(status.fails_again for status in statuses),
            )
        )

    return all_statuses


def seconds_left(statuses: Sequence[CellStatus], jobs: int) -> float | None:
    """Returns the seconds left if no process is idle before the last cell; None if unknown."""
    if any(status.seconds_left is None for status in statuses):
        return None
    times = [status.seconds_left or 0.0 for status in statuses]
    pairs = zip(times, statuses, strict=True)
    total = sum(time * _busy(status.runs_left, jobs) for time, status in pairs)
    return max(total / jobs, *times, 0.0)


def _busy(runs: int, jobs: int) -> float:
    """Returns how many of `jobs` processes are busy, as a mean over the time of a cell's runs.

    Runs are not divided: of three runs, one of two processes has two, and the other one waits.
    """
    return runs / math.ceil(runs / jobs) if runs else 1.0
