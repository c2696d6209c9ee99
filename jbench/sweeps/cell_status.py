"""Status of the cells of a matrix, and the time and memory that what is left of them takes."""

import contextlib
import math
import re
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch

from jbench.agents.batched.pair_buffer import buffer_class
from jbench.cores import cores, one_thread
from jbench.errors import ERRORS_OF_OTHERS
from jbench.settings.engines import ENGINES
from jbench.settings.recorded import COST, SEED, alike, read_run
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.provenance import processor
from jbench.sweeps.batches import batches
from jbench.sweeps.cell import Cell
from jbench.tasks.find import checked_task, find_task
from jbench.training import speed
from jbench.training.status import run_status
from jbench.wording import counted, duration, in_matrix_file

_MIN_REPORTED = 2_000_000_000  # bytes
_USABLE = 0.8  # of the free memory; networks and minibatches take the rest


@dataclass(frozen=True)
class _Estimate:
    """How long a control step of a run takes on this machine.

    Attributes:
        seconds: of a core, or of the GPU; None if it is unknown.
        source: "measured runs", "a quick measurement" or "unknown".
    """

    seconds: float | None
    source: str


_UNKNOWN = _Estimate(None, "unknown")


class CellStatus(NamedTuple):
    """Numbers of seeds of a cell by status, and what is left of all its runs.

    Attributes:
        steps_left: control steps.
        seconds_left: s on this machine; None if unknown.
        estimate: source of `seconds_left`, as of `_Estimate`; empty if nothing is left.
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
    be, it is that of similar finished runs in the results: they may be of a machine with the same
    name that is slower. `jobs` is the number of processes at a time, `device` that of the batched
    engine, and `final_episodes` the number of episodes of last evaluations, if the user typed it.
    """
    recorded = _recorded(results, device)
    measured: dict[tuple[str, int], _Estimate | None] = {}
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

        exactly = alike(cell.runs[0], SEED)
        about = alike(cell.runs[0], COST)
        shape = about, cell.runs[0].steps  # the share of evaluations depends on the steps
        if left and quick and shape not in measured:
            measured[shape] = _quick_measurement(runs, jobs, device, final_episodes)

        known = (measured.get(shape), recorded.get(exactly), recorded.get(about))
        estimate = next(filter(None, known), _UNKNOWN)
        seconds = estimate.seconds
        evaluating = 0.0
        if left and seconds:
            evaluating = _evaluating(cell.runs[0], seconds, device, final_episodes)
        all_statuses.append(
            CellStatus(
                cell,
                finished=states.count("finished"),
                unfinished=states.count("unfinished"),
                failed=states.count("failed"),
                missing=states.count("missing"),
                steps_left=left,
                seconds_left=None if seconds is None else left * seconds / _busy(len(runs), jobs),
                estimate=estimate.source if left else "",
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


def forecast(statuses: Sequence[CellStatus], jobs: int) -> str | None:
    """Returns a sentence on the time left with `jobs` processes at a time, if it is known."""
    seconds = seconds_left(statuses, jobs)
    if not seconds:
        return None

    steps = sum(status.steps_left for status in statuses)
    runs = [run for status in statuses for run in status.cell.runs]
    hints = {
        "fewer --steps (such as 300000)": max(run.steps for run in runs) > 300_000,
        "fewer --seeds (such as 0-2)": len({run.seed for run in runs}) > 3,
    }
    fewer = ", or ".join(hint for hint, applies in hints.items() if applies)
    less = f" For less: {fewer}." if fewer and seconds > 600 else ""

    parts = [(status.evaluating, status.seconds_left or 0.0) for status in statuses]
    share = sum(part * time for part, time in parts) / sum(time for _, time in parts)
    key = in_matrix_file("the key episodes", "evaluation")
    most = (
        f" Evaluations take most of it; fewer --evaluate-episodes {key} make them shorter."
        if share > 0.5
        else ""
    )

    return (
        f"This takes about {duration(seconds)}: {counted(len(runs), 'run')}, {steps:,} control "
        f"steps at {steps / seconds:,.0f} steps/s, {counted(jobs, 'process', 'processes')} at a "
        f"time.{most}{less}"
    )


def memory_sentence(runs: Sequence[RunSettings], device: str = "cpu") -> str | None:
    """Returns a sentence on the replay buffers of concurrent runs; None if they are small.

    A row is an observation in float32, with an action and a reward. An encoder reduces its size. A
    GPU allocates the whole buffer at the start, also for a run that does not fill it.
    """
    needed = 0
    most = 0
    algo = ""  # of the largest buffer
    for run in runs:
        capacity = run.replay_capacity
        if capacity is None:
            continue

        task = find_task(run.task)
        transitions = min(capacity, run.steps) if device == "cpu" else capacity
        row = 4 * (task.observation_size + task.action_size + 1)
        rows = buffer_class(ends_early=task.ends_early).rows_per_transition
        needed += row * rows * transitions
        if transitions > most:
            most = transitions
            algo = run.algo

    if needed < _MIN_REPORTED:
        return None

    what = "memory"
    free = _available()
    if device != "cpu":
        what = "the GPU's memory"
        free = torch.cuda.mem_get_info(device)[0] if torch.cuda.is_available() else None

    text = f"The replay buffers of {len(runs)} runs will take up to {needed / 1e9:.1f} GB of {what}"
    if free is None or needed <= _USABLE * free:
        return f"{text}."

    key = in_matrix_file("the same key", f"hyperparameters.{algo}")
    return (
        f"{text}, and {free / 1e9:.1f} GB are free here: for less, fewer --seeds at a time, or "
        f"--set buffer_size={int(most * free / needed / 2)} {key}."
    )


def _available() -> int | None:
    """Returns the free memory in bytes, where the system tells."""
    with contextlib.suppress(OSError):
        memory = Path("/proc/meminfo").read_text("ascii")
        known = re.search(r"^MemAvailable: *(\d+)", memory, re.MULTILINE)
        return int(known[1]) * 1024 if known else None
    return None


def _evaluating(run: RunSettings, seconds: float, device: str, final_episodes: int | None) -> float:
    """Returns the share of a run's time that its evaluations take; 0 if it can't be measured."""
    steps = speed.evaluation_steps(run, final_episodes)
    if steps <= 1:
        return 0.0
    with contextlib.suppress(*ERRORS_OF_OTHERS):
        stepping = speed.stepping(run, run.evaluate_episodes, device=device)
        return min(1.0, steps * stepping / seconds)
    return 0.0


def _recorded(results: Results, device: str) -> dict[str, _Estimate]:
    """Returns estimates from finished runs here, by their keys `alike` for SEED and for COST."""
    seconds: dict[str, list[float]] = {}
    for record in results.scan("run")[0]:
        summary = record.manifest.summary
        time = summary.get("wall_time")
        steps = summary.get("steps_done")
        if record.is_finished and time and steps and _was_made_here(record, device):
            run = read_run(record.settings)
            with contextlib.suppress(TypeError):  # manifests of others may hold anything
                # The runs of a process share a core, and each records the whole time.
                per_step = time / steps / (summary.get("together") or 1)
                if device == "cpu" and summary.get("processor_time"):
                    per_step = summary["processor_time"] / steps  # without other work
                for free in (SEED, COST):
                    seconds.setdefault(alike(run, free), []).append(per_step)

    return {
        key: _Estimate(statistics.median(measured), "measured runs")
        for key, measured in seconds.items()
    }


def _was_made_here(record: Record, device: str) -> bool:
    """Returns whether a run was trained on this processor, and the device that runs would have."""
    made_on = record.manifest.provenance
    engine = ENGINES.get(str(record.settings.get("engine")))
    now = device.partition(":")[0] if engine is not None and engine.is_for_gpu else "cpu"
    return (
        made_on.get("processor") == processor()
        and made_on.get("cores") == cores()
        and made_on.get("device", "cpu") == now
    )


def _quick_measurement(
    runs: Sequence[RunSettings], jobs: int, device: str, final_episodes: int | None
) -> _Estimate | None:
    """Measures temporary agents, as many as the largest process trains; None if it can't be."""
    checked_task(runs[0].task)
    together = batches(runs, jobs, device)[0]
    try:
        with one_thread():
            seconds = speed.seconds_per_step(together, device, final_episodes=final_episodes)
        return _Estimate(seconds / len(together), "a quick measurement")
    except ERRORS_OF_OTHERS:  # the training will say what is wrong, and stop no other run
        return None
    finally:
        torch.cuda.empty_cache()  # the runs need the memory; without a GPU it does nothing
