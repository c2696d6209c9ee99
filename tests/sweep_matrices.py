"""Helpers of sweep tests: a small matrix, its runs, and the processes of its sweep."""

import contextlib
import os
import signal
import sys
from pathlib import Path

import pytest

from jbench.policies.network import WEIGHTS
from jbench.store import Results, locks
from jbench.studies.matrix import read_matrix
from jbench.sweeps.cell import all_runs, matrix_cells
from tests import command_line
from tests.forking import WORKER_NAME
from tests.training import small_runs

SMALL = """
tasks = [{tasks}]
algos = [{algos}]
representations = [{representations}]
seeds = "{seeds}"
steps = {steps}

[evaluation]
every = 2000
episodes = 1

[dataset]
steps = {dataset}
"""

HYPERPARAMETERS = {
    "td3": """
[hyperparameters.td3]
hidden_layers = [8]
batch_size = 16
learning_starts = 50
train_freq = 50
gradient_steps = {gradient_steps}
""",
    "ppo": """
[hyperparameters.ppo]
hidden_layers = [8]
batch_size = 64
n_envs = 2
n_steps = 128
""",
}

TINY_TD3 = """
[hyperparameters.td3]
hidden_layers = [8]
batch_size = 8
learning_starts = 20
train_freq = 20
gradient_steps = 1
"""
"""For runs of a few hundred control steps."""

DEFAULTS = {
    "tasks": '"face_direction"',
    "algos": '"td3"',
    "representations": '"full"',
    "seeds": "0-1",
}
DEFAULTS["steps"] = 2000
DEFAULTS["dataset"] = 4000
DEFAULTS["gradient_steps"] = 2


def write_matrix(path, **changes):
    """Writes a matrix of tiny networks into a file; returns its name.

    Args:
        path: directory of the file.
        changes: of `DEFAULTS`.
    """
    file, values = path / "small.toml", {**DEFAULTS, **changes}
    tables = [text for algo, text in HYPERPARAMETERS.items() if f'"{algo}"' in values["algos"]]
    file.write_text("".join([SMALL, *tables]).format(**values))
    return str(file)


def runs_of_matrix(matrix, path):
    """Returns the settings of all runs of a matrix."""
    return all_runs(matrix_cells(read_matrix(matrix), Results(path)))


_started = []


def start(*arguments, results, short=True):
    """Starts a sweep in a new process and process group."""
    process = command_line.start("sweep", *arguments, results=results, short=short)
    _started.append(process)
    return process


def end_all():
    """Kills processes that a failing test did not end, including stopped ones."""
    while _started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(_started.pop().pid, signal.SIGKILL)


def ended(process):
    """Waits until a process ends; returns its standard output and standard error."""
    out, err = process.communicate(timeout=600)
    return out + err


def held(runs, path):
    """Returns the runs that a process is writing."""
    return [run for run in runs if locks.is_held(Path(path) / "runs" / run.id)]


def committed(run, path):
    """Returns the number of committed episodes of a run."""
    record = Results(path).find("run", run.id)
    return 0 if record is None else record.rows("episodes")


def states(runs, path):
    """Returns the status of each run."""
    return [getattr(Results(path).find("run", run.id), "status", None) for run in runs]


def rows(runs, path):
    """Returns all rows of runs except for times, and their weights."""
    records = [Results(path).find("run", run.id) for run in runs]
    return [(small_runs.rows(record), record.read_file(WEIGHTS)) for record in records]


def workers(process):
    """Returns the ids of the worker processes below a process; skips the test without /proc."""
    if sys.platform != "linux":
        pytest.skip("finds processes in /proc")
    pids = set()
    waiting = [process if isinstance(process, int) else process.pid]
    while waiting:
        pid = waiting.pop()
        with contextlib.suppress(OSError):  # it has ended meanwhile
            forked = Path(f"/proc/{pid}/comm").read_text().strip() == WORKER_NAME
            command = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            if forked or b"jbench.training.worker" in command:
                # Its own new child processes have its name for a moment.
                pids.add(pid)
                continue
            for task in Path(f"/proc/{pid}/task").iterdir():
                waiting += map(int, (task / "children").read_text().split())
    return pids
