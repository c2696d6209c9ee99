"""Trains a sweep on a Ray cluster whose nodes share the results directory.

Each batch of runs is a task. Ray pickles arguments and results of tasks, but these are JSON texts
here, so that no object of jbench is pickled. A task starts the same worker process as the local
executor.
"""

import contextlib
import json
import os
import platform
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from jbench.errors import RequestError, WorkError
from jbench.settings.run import RunSettings
from jbench.store import Results, locks, schema
from jbench.store.follow import LOOK_EVERY
from jbench.sweeps.executors import Local, worker_request
from jbench.sweeps.prepare import is_finished
from jbench.training.events import Event

_ANSWERS_WITHIN = 10.0  # s; timeout of the connection to a cluster
_SEEN_WITHIN = 90.0  # s; a network file system may show the writes of another node late


class Ray:
    """Tasks on a Ray cluster, each with a core and optionally a share of a GPU."""

    def __init__(
        self,
        results: Results,
        address: str | None,
        jobs: int = 0,
        gpus_per_task: float = 0.0,
        **options: Any,
    ) -> None:
        """Joins a cluster, or starts one on this machine.

        The results directory has the same path on all nodes. Without an address it is RAY_ADDRESS,
        else a cluster on this machine. `jobs` is the number of tasks at a time; 0 for as many as
        the cluster has resources for. `options` are as of `Local`. Raises a RequestError if Ray is
        not installed, there is no such cluster, or it lacks GPUs; a WorkError if the results
        directory can't be locked.
        """
        try:
            import ray
            import ray.exceptions
        except ImportError:
            hint = "--executor ray needs Ray; type pip install 'jbench[cluster]'."
            raise RequestError(hint) from None
        self._ray: Any = ray
        self._results, self._options = Results(results.path.resolve()), options
        self._stopped = threading.Event()
        self._tasks: set[Any] = set()
        with contextlib.ExitStack() as stack:
            self._join(address or os.environ.get("RAY_ADDRESS"), jobs)
            stack.callback(ray.shutdown)
            room = self._room(gpus_per_task)
            stack.enter_context(locks.share(self._results.path))
            self._held = stack.pop_all()
        self.jobs = jobs or room
        self.device = "cuda" if gpus_per_task else "cpu"
        # If a node dies, Ray restarts its tasks on another one, without limit.
        node = {"num_cpus": 1, "max_retries": -1, "scheduling_strategy": "SPREAD"}
        self._task = self._ray.remote(num_gpus=gpus_per_task, **node)(train_batch)

    def train(self, runs: Sequence[RunSettings]) -> Iterator[Event]:
        """Trains runs in a task; see `Local`. Their progress is read from the results."""
        task = self._task.remote(worker_request(runs, self._results, self.device, self._options))
        self._tasks.add(task)
        try:
            seen: dict[str, str] = {}
            while not self._ray.wait([task], timeout=LOOK_EVERY)[0]:
                if self._stopped.is_set():
                    return
                yield from self._progress(runs, seen)
            yield from self._outcome(runs, task)
        finally:
            self._tasks.discard(task)

    def stop(self) -> None:
        """Cancels the tasks, whose processes end with them; leaves the cluster, or ends its own."""
        self._stopped.set()
        for task in list(self._tasks):
            with contextlib.suppress(Exception):
                self._ray.cancel(task, force=True)
        while self._tasks:  # their threads may be asking Ray
            time.sleep(0.1)
        self._held.close()

    def _join(self, address: str | None, jobs: int) -> None:
        # Usage statistics of Ray are opt-in.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        here = {} if address else {"num_cpus": jobs or None, "include_dashboard": False}
        try:
            if address and address not in ("auto", "local"):
                # Ray itself retries an unreachable address for many minutes.
                host, _, port = address.removeprefix("ray://").rpartition(":")
                if not port.isdecimal() or int(port) >= 2**16:
                    raise ValueError("it is not HOST:PORT")
                socket.create_connection((host, int(port)), _ANSWERS_WITHIN).close()
            self._ray.init(address or "local", log_to_driver=False, logging_level="ERROR", **here)
        except (OSError, ValueError, RuntimeError) as error:
            reason = (str(error).splitlines() or [""])[0]
            raise RequestError(
                f"No Ray cluster can be joined at {address or 'this machine'} ({reason}); type "
                "--address HOST:6379 of a cluster started with ray start --head."
            ) from None

    def _room(self, gpus_per_task: float) -> int:
        resources = self._ray.cluster_resources()
        room = int(resources.get("CPU", 0))
        if gpus_per_task:
            gpus = resources.get("GPU", 0)
            if gpus < gpus_per_task:
                raise RequestError(
                    f"--gpus-per-task {gpus_per_task:g}: the cluster has {gpus:g} GPUs; type less, "
                    "or 0 for none."
                )
            room = min(room, int(gpus / gpus_per_task))
        return max(1, room)

    def _progress(self, runs: Sequence[RunSettings], seen: dict[str, str]) -> Iterator[Event]:
        for run in runs:
            with contextlib.suppress(WorkError):
                record = self._results.find("run", run.id)
                if record is None or seen.get(run.id) == record.manifest.updated:
                    continue
                seen[run.id] = record.manifest.updated
                for part in record.parts("episodes")[-1:]:
                    last = record.read_part(part, schema.EPISODES).to_pylist()[-1]
                    steps, episode_return = last["control_steps"], last["episode_return"]
                    yield Event("episode", run.id, steps=steps, episode_return=episode_return)

    def _outcome(self, runs: Sequence[RunSettings], task: Any) -> Iterator[Event]:
        """Yields the last events of a task; none if the task was lost."""
        try:
            ended = [Event(**content) for content in json.loads(self._ray.get(task))]
        except self._ray.exceptions.RayTaskError as error:
            reason = (str(error.cause).splitlines() or [""])[0]
            ended = [Event("failed", run.id, f"its task failed: {reason}") for run in runs]
        except self._ray.exceptions.RayError:
            return
        for event in ended:
            if event.kind == "finished" and not self._arrives(event.run):
                reason = (
                    f"it is finished where it ran, but not in {self._results.path} here; all nodes "
                    "must share that directory"
                )
                yield Event("failed", event.run, reason)
            else:
                yield event

    def _arrives(self, run: str) -> bool:
        deadline = time.monotonic() + _SEEN_WITHIN
        while not is_finished(self._results, "run", run):
            if time.monotonic() > deadline or self._stopped.wait(LOOK_EVERY):
                return False
        return True


def train_batch(request: str) -> str:
    """Trains a `worker_request` on the node where Ray calls this; returns last events as JSON."""
    content = json.loads(request)
    path = Path(content["results"])
    runs = [RunSettings(**settings) for settings in content["runs"]]
    # The sweep holds a lock on the directory. A node that does not see it has another directory, or
    # could write a run at the same time as another process.
    if not path.is_dir() or not locks.is_shared(path):
        reason = (
            f"on the node {platform.node()}, {path} is not the sweep's, or its locks are not seen "
            "there: all nodes must share it, with flock (docs/cluster.md)"
        )
        ended = [Event("failed", run.id, reason) for run in runs]
    else:
        events = Local(Results(path)).run(request)
        ended = [event for event in events if event.is_last]
    return f"[{', '.join(event.to_json() for event in ended)}]"
