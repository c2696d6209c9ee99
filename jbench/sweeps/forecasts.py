"""Sentences on the memory and the time that cells need on this machine."""

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

from jbench.agents.batched.pair_buffer import buffer_class
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.sweeps.batches import batches
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.cell_status import CellStatus, cell_statuses, seconds_left
from jbench.sweeps.executors import Local
from jbench.tasks.find import find_task
from jbench.wording import counted, duration, in_matrix_file

_MIN_REPORTED = 2_000_000_000  # bytes
_USABLE = 0.8  # of the free memory; networks and minibatches take the rest


def forecasts(cells: Sequence[Cell], results: Results, local: Local) -> Iterator[str]:
    """Yields sentences on the memory and time that cells need on this machine, if known."""
    device = local.device
    waiting = batches(all_runs(cells), local.jobs, device)
    jobs = min(local.jobs, len(waiting))
    statuses = cell_statuses(cells, results, jobs, device, final_episodes=local.final_episodes)
    memory = memory_sentence([run for batch in waiting[:jobs] for run in batch], device)
    yield from filter(None, (memory, time_sentence(statuses, jobs)))


def time_sentence(statuses: Sequence[CellStatus], jobs: int) -> str | None:
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

    named = counted(len(runs), "run")
    text = f"The replay buffers of {named} will take up to {needed / 1e9:.1f} GB of {what}"
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
