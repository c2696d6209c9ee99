"""Tasks on a Ray cluster, in which runs are trained.

Ray pickles arguments and results of tasks, but these are JSON texts here, so that no object of
jbench is pickled. A task starts the same worker process as `Local`.
"""

import contextlib
import json
import os
import platform
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from jbench.errors import RequestError, WorkError
from jbench.settings.run import RunSettings
from jbench.store import Results, locks, schema
from jbench.store.follow import POLL_SECONDS
from jbench.sweeps.executors import Local
from jbench.training.events import (
    EpisodeEnded,
    Failed,
    Finished,
    LastEvent,
    WorkerEvent,
    from_json,
    to_json,
)


class Ray:
    """Tasks on a Ray cluster, each with a core and optionally a share of a GPU."""

    def __init__(
        self, results: Results, address: str | None, jobs: int, gpus_per_task: float, **options: Any
    ) -> None:
        """Joins a cluster, or starts one on this machine, until this process ends.

        The results directory has the same path on all nodes. Without an address it is RAY_ADDRESS,
        else a cluster on this machine. `jobs` is the number of tasks at a time; 0 for as many as
        the cluster has resources for. `options` are as of `Local`. Raises a RequestError if Ray is
        not installed, there is no such cluster, or it lacks GPUs.
        """
        try:
            import ray
            import ray.exceptions
        except ImportError:
            hint = "--executor ray needs Ray; type pip install 'jbench[cluster]'."
            raise RequestError(hint) from None

        self._ray: Any = ray
        self.device = "cuda" if gpus_per_task else "cpu"
        self._results = Results(results.path.resolve())
        self._worker = Local(self._results, 1, self.device, **options)
        self._stopped = threading.Event()
        self._seen: dict[str, str] = {}

        self._join(address or os.environ.get("RAY_ADDRESS"), jobs)
        room = self._room(gpus_per_task)
        self.jobs = jobs or room

        # If a node dies, Ray restarts its tasks on another one, without limit.
        node = {"num_cpus": 1, "max_retries": -1, "scheduling_strategy": "SPREAD"}
        self._task = self._ray.remote(num_gpus=gpus_per_task, **node)(train_batch)

    def train(self, runs: Sequence[RunSettings]) -> Iterator[WorkerEvent]:
        """Trains runs in a task; see `Local`. Their progress is read from the results."""
        with locks.share(self._results.path):
            task = self._task.remote(self._worker.request(runs))
            while not self._ray.wait([task], timeout=POLL_SECONDS)[0]:
                if self._stopped.is_set():
                    self._ray.cancel(task, force=True)  # its process ends with it
                    return
                yield from self._progress(runs)
            yield from self._outcome(runs, task)

    def stop(self) -> None:
        """Lets each thread cancel its task, within seconds."""
        self._stopped.set()

    def _join(self, address: str | None, jobs: int) -> None:
        """Connects to a cluster, or starts one on this machine."""
        # Usage statistics of Ray are opt-in.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
        if not address:
            options["num_cpus"] = jobs or None
            options["include_dashboard"] = False

        try:
            if address and address not in ("auto", "local"):
                # Ray itself retries an unreachable address for many minutes.
                host, _, port = address.removeprefix("ray://").rpartition(":")
                if not port.isdecimal() or int(port) >= 2**16:
                    raise ValueError("it is not HOST:PORT")
                socket.create_connection((host, int(port)), timeout=10).close()

            self._ray.init(address or "local", ignore_reinit_error=True, **options)
        except (OSError, ValueError, RuntimeError) as error:
            reason = (str(error).splitlines() or [""])[0]
            raise RequestError(
                f"No Ray cluster can be joined at {address or 'this machine'} ({reason}); type "
                "--address HOST:6379 of a cluster started with ray start --head."
            ) from None

    def _room(self, gpus_per_task: float) -> int:
        """Returns for how many tasks at a time the cluster has resources, at least one.

        Raises a RequestError if it has not the GPUs of a single task.
        """
        resources = self._ray.cluster_resources()
        room = int(resources.get("CPU", 0))
        gpus = resources.get("GPU", 0)
        if gpus < gpus_per_task:
            raise RequestError(
                f"--gpus-per-task {gpus_per_task:g}: the cluster has {gpus:g} GPUs; type less, or "
                "0 for none."
            )

        if gpus_per_task:
            room = min(room, int(gpus / gpus_per_task))
        return max(1, room)

    def _progress(self, runs: Sequence[RunSettings]) -> Iterator[EpisodeEnded]:
        """Yields the last episode of each run that was committed since it was looked at."""
        for run in runs:
            with contextlib.suppress(WorkError):
                record = self._results.find("run", run.id)
                if record is None or self._seen.get(run.id) == record.manifest.updated:
                    continue
                self._seen[run.id] = record.manifest.updated
                for part in record.parts("episodes")[-1:]:
                    last = record.read_part(part, schema.EPISODES).to_pylist()[-1]
                    yield EpisodeEnded(run.id, last["control_steps"], last["episode_return"])

    def _outcome(self, runs: Sequence[RunSettings], task: Any) -> Iterator[LastEvent]:
        """Yields the last events of a task; none if the task was lost."""
        try:
            ended = [from_json(values) for values in json.loads(self._ray.get(task))]
        except self._ray.exceptions.RayTaskError as error:
            reason = (str(error.cause).splitlines() or [""])[0]
            ended = [Failed(run.id, f"its task failed: {reason}") for run in runs]
        except self._ray.exceptions.RayError:
            return

        where = f"it is finished where it ran, but not in {self._results.path} here"
        for event in ended:
            assert isinstance(event, LastEvent)
            if isinstance(event, Finished) and not self._arrives(event.run):
                yield Failed(event.run, f"{where}; all nodes must share that directory")
            else:
                yield event

    def _arrives(self, run: str) -> bool:
        """Waits 90 s at most for a run, as a network file system may show it late."""
        for _ in range(round(90 / POLL_SECONDS)):
            if self._results.is_finished("run", run) or self._stopped.wait(POLL_SECONDS):
                return True
        return False


def train_batch(request: str) -> str:
    """Trains a `Local.request` on the node where Ray calls this; returns last events as JSON."""
    content = json.loads(request)
    path = Path(content["results"])
    runs = [RunSettings(**run) for run in content["runs"]]

    # The sweep holds a lock on the directory. A node that does not see it has another directory, or
    # could write a run at the same time as another process.
    if not locks.is_held(path, shared=True):
        reason = (
            f"on the node {platform.node()}, {path} is not the sweep's, or its locks are not seen "
            "there: all nodes must share it, with flock (docs/cluster.md)"
        )
        ended: list[WorkerEvent] = [Failed(run.id, reason) for run in runs]
    else:
        sys.argv = content["command"]  # which records contain
        if Path(content["directory"]).is_dir():
            os.chdir(content["directory"])
        events = Local(Results(path), 1, **content["options"]).train(runs)
        ended = [event for event in events if isinstance(event, LastEvent)]

    return json.dumps([to_json(event) for event in ended])
