"""Where runs are trained: worker processes on this machine, or a Ray cluster (`cluster.py`)."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jbench.cores import cores
from jbench.errors import WorkError
from jbench.names import ONE_THREAD
from jbench.settings.alike import SEED, alike
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.events import Event


class Local:
    """Worker processes of one thread each on this machine."""

    def __init__(
        self, results: Results, jobs: int = 0, device: str = "cpu", **options: Any
    ) -> None:
        """Starts no process yet; 0 jobs are `default_jobs`, options are those of `run_batch`."""
        self.jobs, self.device = jobs or default_jobs(device), device
        self._results, self._options = results, options
        self._processes: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def train(self, runs: Sequence[RunSettings]) -> Iterator[Event]:
        """Yields the events of runs in a process; if it dies, some runs have no last event."""
        return self.run(worker_request(runs, self._results, self.device, self._options))

    def run(self, request: str) -> Iterator[Event]:
        """Starts a worker with a `worker_request` and yields its events, but none after `stop`."""
        process = _start()
        assert process.stdin is not None
        assert process.stdout is not None
        self._processes.add(process)
        try:
            if self._stopped:  # while the process was started, so `stop` did not find it
                return
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
        """Kills all workers and starts no more; what they have not committed is lost."""
        self._stopped = True
        for process in list(self._processes):
            process.kill()


def default_jobs(device: str) -> int:
    """Returns the number of processes at a time: one for each core, or one for a GPU."""
    return cores() if device == "cpu" else 1


def batches(runs: Sequence[RunSettings], jobs: int, device: str) -> list[list[RunSettings]]:
    """Returns the runs of each process.

    On a CPU the seeds of a configuration are divided among `jobs` processes. On a GPU they are one
    stack in one process. A run of another engine than the batched one has its own process.
    """
    configurations: dict[str, list[RunSettings]] = {}
    for run in runs:
        key = alike(run, SEED) if run.engine == "batched" else run.id
        configurations.setdefault(key, []).append(run)
    most = jobs if device == "cpu" else 1
    return [
        [seeds[i] for i in part]
        for seeds in configurations.values()
        for part in np.array_split(range(len(seeds)), min(most, len(seeds)))
    ]


def worker_request(
    runs: Sequence[RunSettings], results: Results, device: str, options: Mapping[str, Any]
) -> str:
    """Returns the request as a line of JSON, with the command that the worker records."""
    request = {"results": str(results.path), "options": {"device": device, **options}}
    return json.dumps({**request, "command": sys.argv, "runs": [run.values for run in runs]})


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
    """Blocks SIGINT in this thread and in workers, until they ignore it: no traceback on Ctrl-C."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
