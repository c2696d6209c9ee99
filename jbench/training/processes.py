"""Worker processes on this machine: starts them, reads their messages, stops all of them."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import IO, Any

from jbench.errors import WorkError
from jbench.settings.run import RunSettings
from jbench.store import Results

Message = dict[str, Any]
"""What a worker reports: see `jbench.training.worker`."""


def worker_request(
    runs: Sequence[RunSettings],
    results: Results,
    device: str,
    checkpoint_every: float,
    measure: bool = False,
) -> str:
    """Returns the request to a worker as one line of JSON.

    It holds the command line of this process, which the worker writes into the records.

    Args:
        runs: to train.
        results: where they are written.
        device: that the batched engine learns on.
        checkpoint_every: least time between two checkpoints of a run (s).
        measure: whether the worker first measures and reports how long a control step takes.
    """
    request = {
        "results": str(results.path),
        "device": device,
        "checkpoint_every": checkpoint_every,
        "measure": measure,
        "command": sys.argv,
        "runs": [run.model_dump(mode="json") for run in runs],
    }
    return json.dumps(request)


class Workers:
    """The workers of one command. They may be started from several threads."""

    def __init__(self) -> None:
        """Starts none yet."""
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped = False

    @contextlib.contextmanager
    def run(self, request: str) -> Iterator[Iterator[Message]]:
        """Starts a worker and yields its messages as they arrive; none after `stop`.

        Args:
            request: as `worker_request` returns it.

        Raises:
            WorkError: if the process can't be started.
        """
        # `stop` waits for this lock, so that it also finds a process that is being started.
        with self._lock:
            process = None if self._stopped else _start()
            if process is not None:
                self._running.add(process)
        if process is None:
            yield iter(())
            return
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            with contextlib.suppress(BrokenPipeError):  # it has died: it sends no messages
                process.stdin.write(f"{request}\n")
                process.stdin.flush()
            yield _messages(process.stdout)
            process.wait()
        finally:
            process.kill()
            process.wait()
            self._running.discard(process)
            process.stdout.close()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()

    def stop(self) -> None:
        """Kills all workers and starts no more; what they have not committed is lost."""
        with self._lock:
            self._stopped = True
            for process in list(self._running):
                process.kill()


def _start() -> subprocess.Popen[str]:
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    # The worker inherits the mask: a Ctrl-C before it ignores them must not print a traceback.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "jbench.training.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **threads, "MUJOCO_GL": "disable"},
        )
    except OSError as error:
        raise WorkError(f"A process can't be started ({error.strerror}).") from None
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _messages(stdout: IO[str]) -> Iterator[Message]:
    for line in stdout:
        if line.endswith("\n"):  # else the worker was killed while it wrote
            yield json.loads(line)
