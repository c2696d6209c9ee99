"""Worker processes on this machine that train runs; `cluster.py` has the tasks of a cluster."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from jbench.cores import ONE_THREAD, cores
from jbench.errors import WorkError
from jbench.settings.engines import ENGINES
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.events import WorkerEvent, from_json


class Local:
    """Worker processes of one thread each on this machine."""

    def __init__(
        self, results: Results, jobs: int = 0, device: str = "cpu", **options: Any
    ) -> None:
        """Starts no process yet; 0 jobs are `default_jobs`, options are those of `run_batch`."""
        self.jobs = jobs or default_jobs(device)
        self.device = device
        self.final_episodes: int | None = options.get("final_episodes")
        self._results = results
        self._options = options
        self._processes: set[subprocess.Popen[str]] = set()
        self._stopped = False

    def train(self, runs: Sequence[RunSettings]) -> Iterator[WorkerEvent]:
        """Yields the events of runs in a process; if it dies, some runs have no last event."""
        process = _start()
        assert process.stdin is not None
        assert process.stdout is not None
        self._processes.add(process)

        try:
            if self._stopped:  # while the process was started, so `stop` did not find it
                return
            with contextlib.suppress(BrokenPipeError):  # it has died: it reports nothing
                process.stdin.write(f"{self.request(runs)}\n")
                process.stdin.flush()
            for line in process.stdout:
                if line.endswith("\n"):  # else the worker was killed while it wrote
                    yield from_json(json.loads(line))
            process.wait()
        finally:
            process.kill()
            process.wait()
            self._processes.discard(process)
            process.stdout.close()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()

    def request(self, runs: Sequence[RunSettings]) -> str:
        """Returns a worker's request as a line of JSON.

        It has the command, which records contain, and the working directory, which may have a
        module of the user.
        """
        device = self.device if ENGINES[runs[0].engine].is_for_gpu else "cpu"
        options = {"device": device, **self._options}
        request = {
            "results": str(self._results.path),
            "options": options,
            "command": sys.argv,
            "directory": os.getcwd(),
            "runs": [run.values for run in runs],
        }
        return json.dumps(request)

    def stop(self) -> None:
        """Kills all workers and starts no more; what they have not committed is lost."""
        self._stopped = True
        for process in list(self._processes):
            process.kill()


def default_jobs(device: str) -> int:
    """Returns the number of processes at a time: one for each core.

    On a GPU it is one for every five: a stack spends most of its time in Python (docs/speed.md).
    """
    return cores() if device == "cpu" else max(1, cores() // 5)


def _start() -> subprocess.Popen[str]:
    """Starts a worker in which SIGINT is blocked until it ignores it: no traceback on Ctrl-C."""
    can_block = hasattr(signal, "pthread_sigmask")  # not on Windows
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if can_block else None
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "jbench.training.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **ONE_THREAD, "MUJOCO_GL": "disable"},
        )
    except OSError as error:
        raise WorkError(f"A process can't be started ({error.strerror}).") from None
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
