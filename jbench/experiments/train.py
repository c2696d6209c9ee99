"""Many runs side by side: one process of one thread for each core."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, NamedTuple

from jbench.experiments.settings import RunSettings
from jbench.store import Results

Message = dict[str, Any]
"""What a worker says: see `jbench.experiments.worker`."""


class Plan(NamedTuple):
    """Which runs of those asked for are done, begun and new."""

    finished: list[RunSettings]
    begun: list[RunSettings]
    new: list[RunSettings]

    @property
    def to_do(self) -> list[RunSettings]:
        """The runs that are not finished, in the order asked for."""
        return self.begun + self.new


def plan(runs: list[RunSettings], results: Results) -> Plan:
    """Returns which of these runs the results hold already.

    Raises:
        WorkError: if the manifest of one of them can't be read.
    """
    made = Plan([], [], [])
    for settings in runs:
        record = results.find("run", settings.id)
        if record is None:
            made.new.append(settings)
        else:
            (made.finished if record.status == "finished" else made.begun).append(settings)
    return made


def train(
    runs: list[RunSettings],
    results: Results,
    jobs: int,
    on_message: Callable[[RunSettings, Message], None],
) -> dict[str, str]:
    """Does runs side by side, each in a process of its own with one thread.

    Args:
        runs: what to do.
        results: where they go.
        jobs: how many at a time.
        on_message: called, one call at a time, with each message of a run.

    Returns:
        A sentence for each run that failed, by its id; one failure does not stop the others.
    """
    failures: dict[str, str] = {}
    turn = threading.Lock()

    def work(settings: RunSettings) -> None:
        failed: str | None = "its process ended without a word"
        with _worker(settings, results) as messages:
            for message in messages:
                if "failed" in message:
                    failed = message["failed"]
                elif "finished" in message:
                    failed = None
                with turn:
                    on_message(settings, message)
        if failed is not None:
            failures[settings.id] = failed

    with ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(work, settings) for settings in runs]
        try:
            for future in futures:
                future.result()
        except BaseException:
            # Ctrl-C: no new runs; those under way end as their standard input closes.
            pool.shutdown(wait=False, cancel_futures=True)
            _stop_all()
            raise
    return failures


_running: set[subprocess.Popen[str]] = set()


@contextmanager
def _worker(settings: RunSettings, results: Results) -> Iterator[Iterator[Message]]:
    """Starts a worker; gives its messages as they come."""
    request = {"results": str(results.path), "settings": settings.model_dump(mode="json")}
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    process = subprocess.Popen(
        [sys.executable, "-m", "jbench.experiments.worker", json.dumps(request)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **threads, "MUJOCO_GL": "disable"},
    )
    _running.add(process)
    try:
        assert process.stdout is not None
        yield (json.loads(line) for line in process.stdout)
        process.wait()
    finally:
        process.kill()
        process.wait()
        _running.discard(process)


def _stop_all() -> None:
    for process in list(_running):
        process.kill()
