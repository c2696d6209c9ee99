"""Where runs are trained: worker processes on this machine, or a Ray cluster (`cluster.py`)."""

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

from jbench.cores import cores
from jbench.errors import WorkError
from jbench.names import CHECKPOINT_EVERY, ONE_THREAD
from jbench.settings.alike import SEED, alike, stack_key
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.antiphase import divided
from jbench.training.events import Event
from jbench.training.memory import stacks_for_memory

_MAX_STACK = 500  # runs of a process, which holds a lock file of each; many systems allow 1024


class WorkerOptions(NamedTuple):
    """Options of `jbench.training.batched_run.run_batch` that a worker gets."""

    checkpoint_every: float = CHECKPOINT_EVERY
    final_episodes: int | None = None
    keep_state: bool = False


DEFAULTS = WorkerOptions()


class Executor(Protocol):
    """Trains batches of runs, several at a time, each called from its own thread.

    Attributes:
        jobs: number of batches at a time.
        device: of the batched engine: `cpu`, `cuda` or such as `cuda:1`.
    """

    jobs: int
    device: str

    def train(self, runs: Sequence[RunSettings]) -> Iterator[Event]:
        """Trains runs that may share a process, and yields the events of their worker.

        If their process dies, it ends without the last event of some of the runs.
        """

    def stop(self) -> None:
        """Ends all processes and starts no more; what they have not committed is lost."""


class Local:
    """Worker processes of one thread each on this machine."""

    def __init__(
        self,
        results: Results,
        jobs: int = 0,
        device: str = "cpu",
        options: WorkerOptions = DEFAULTS,
    ) -> None:
        """Starts no process yet.

        Args:
            results: where the runs are written.
            jobs: processes at a time; 0 for `default_jobs`.
            device: `cpu`, `cuda` or such as `cuda:1`.
        """
        self.jobs, self.device = jobs or default_jobs(device), device
        self._results, self._options = results, options
        self._lock = threading.Lock()
        self._processes: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def train(self, runs: Sequence[RunSettings]) -> Iterator[Event]:
        """Trains runs in one process; see `Executor`."""
        return self.run(worker_request(runs, self._results, self.device, self._options))

    def run(self, request: str) -> Iterator[Event]:
        """Starts a worker and yields its events as they arrive; none after `stop`.

        Args:
            request: see `worker_request`.

        Raises:
            WorkError: if the process can't be started.
        """
        # `stop` waits for this lock, so that it also finds a process that is being started.
        with self._lock:
            if self._stopped:
                return
            process = _start()
            self._processes.add(process)
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            with contextlib.suppress(BrokenPipeError):  # it has died: it reports nothing
                process.stdin.write(f"{request}\n")
                process.stdin.flush()
            for line in process.stdout:
                if line.endswith("\n"):  # else the worker was killed while it wrote
                    yield Event(**json.loads(line))
            process.wait()
        finally:
            process.kill()
            process.wait()
            self._processes.discard(process)
            process.stdout.close()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()

    def stop(self) -> None:
        """Kills all workers and starts no more."""
        with self._lock:
            self._stopped = True
            for process in list(self._processes):
                process.kill()


def default_jobs(device: str) -> int:
    """Returns the number of processes at a time: one for each core, or one for a GPU."""
    return cores() if device == "cpu" else 1


def batches(runs: Sequence[RunSettings], jobs: int, device: str) -> list[list[RunSettings]]:
    """Returns the runs of each process.

    On a CPU the seeds of a cell are divided among `jobs` processes. On a GPU the cells of a stack
    (`jbench.settings.alike.stack_key`) share one process; they are divided only among several jobs,
    or if they are too many for the GPU's memory or a process. A run of another engine has its own
    process.
    """
    if device == "cpu":
        cells = _grouped(runs, lambda run: alike(run, SEED))
        return [part for cell in cells for part in divided(cell, jobs)]
    together = []
    for stack in _grouped(runs, stack_key):
        cells = _grouped(stack, lambda run: alike(run, SEED))
        parts = max(
            jobs, stacks_for_memory(stack, device, jobs), math.ceil(len(stack) / _MAX_STACK)
        )
        together += [[run for cell in part for run in cell] for part in divided(cells, parts)]
    return together


def _grouped(
    runs: Sequence[RunSettings], key: Callable[[RunSettings], str]
) -> list[list[RunSettings]]:
    """Returns the runs with equal keys; a run of another engine than the batched one is alone."""
    groups: dict[str, list[RunSettings]] = {}
    for run in runs:
        groups.setdefault(key(run) if run.engine == "batched" else run.id, []).append(run)
    return list(groups.values())


def worker_request(
    runs: Sequence[RunSettings], results: Results, device: str, options: WorkerOptions
) -> str:
    """Returns the request to a worker as one line of JSON.

    It includes the command line of this process, which the worker writes into the records.
    """
    request = {
        "results": str(results.path),
        "options": {"device": device, **options._asdict()},
        "command": sys.argv,
        "runs": [run.values for run in runs],
    }
    return json.dumps(request)


def _start() -> subprocess.Popen[str]:
    try:
        with _blocked_interrupts():
            return subprocess.Popen(
                [sys.executable, "-m", "jbench.training.worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env={**os.environ, **ONE_THREAD, "MUJOCO_GL": "disable"},
            )
    except OSError as error:
        raise WorkError(f"A process can't be started ({error.strerror}).") from None


@contextlib.contextmanager
def _blocked_interrupts() -> Iterator[None]:
    """Blocks SIGINT in this thread and in processes that it starts, where signals can be blocked.

    A worker inherits the mask: a Ctrl-C before the worker ignores it must not print a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
