"""The runs of a sweep on a Ray cluster: each batch of them is a task, on results that nodes share.

Ray hands tasks to its workers by pickle. What goes to a task and comes back is text, JSON, and the
task starts the same worker process as the local executor: no object of ours is pickled, and what
the results hold is read as everywhere else.
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
from jbench.names import CHECKPOINT_EVERY
from jbench.settings.run import RunSettings
from jbench.store import Results, locks, schema
from jbench.sweeps.executors import Local, Message, worker_request
from jbench.training.status import run_status

_ANSWERS_WITHIN = 10.0  # s; a cluster that is there
_LOOK_EVERY = 2.0  # s between two looks at the results while a task goes on
_SEEN_WITHIN = 90.0  # s; what a node has written, a network directory may show late


class Ray:
    """The tasks of a Ray cluster, each with a core and, where asked for, a share of a GPU."""

    def __init__(
        self,
        results: Results,
        address: str | None,
        jobs: int = 0,
        gpus_per_task: float = 0.0,
        checkpoint_every: float = CHECKPOINT_EVERY,
    ) -> None:
        """Joins a cluster, or starts one on this machine.

        Args:
            results: where the runs go; a directory that all nodes have under the same path.
            address: of the cluster; None for that of RAY_ADDRESS, else one on this machine.
            jobs: tasks at a time; 0 for as many as the cluster has room for at this moment.
            gpus_per_task: GPUs, or a share of one.
            checkpoint_every: least time between two checkpoints of a run (s).

        Raises:
            RequestError: if Ray is not installed, there is no such cluster, or it has no GPU.
            WorkError: if the results directory can't be locked.
        """
        self._ray = _imported()
        self._results, self._checkpoint_every = Results(results.path.resolve()), checkpoint_every
        self._stopped = threading.Event()
        self._tasks: set[Any] = set()
        self._held = contextlib.ExitStack()
        self._join(address or os.environ.get("RAY_ADDRESS"), jobs)
        try:
            room = self._room(gpus_per_task)
            self._held.enter_context(locks.share(self._results.path))
        except (RequestError, WorkError):
            self.close()
            raise
        self.jobs = jobs or room
        self.device = "cuda" if gpus_per_task else "cpu"
        # Ray gives a task whose node died to another one, as often as it takes.
        options = {"num_cpus": 1, "max_retries": -1, "scheduling_strategy": "SPREAD"}
        self._task = self._ray.remote(num_gpus=gpus_per_task, **options)(train_batch)

    def train(self, runs: Sequence[RunSettings]) -> Iterator[Message]:
        """Trains runs in a task; see `Executor`. Their progress is read from the results."""
        request = worker_request(runs, self._results, self.device, self._checkpoint_every)
        task = self._task.remote(request)
        self._tasks.add(task)
        try:
            seen: dict[str, str] = {}
            while not self._ray.wait([task], timeout=_LOOK_EVERY)[0]:
                if self._stopped.is_set():
                    return
                yield from self._progress(runs, seen)
            yield from self._outcome(runs, task)
        finally:
            self._tasks.discard(task)

    def stop(self) -> None:
        """Cancels the tasks; their processes end with them."""
        self._stopped.set()
        for task in list(self._tasks):
            with contextlib.suppress(Exception):
                self._ray.cancel(task, force=True)

    def close(self) -> None:
        """Leaves the cluster, or ends it if it was started here."""
        self._ray.shutdown()
        self._held.close()

    def _join(self, address: str | None, jobs: int) -> None:
        # Nothing about this cluster is sent to Ray's makers unless somebody asks for it.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        here = {} if address else {"num_cpus": jobs or None, "include_dashboard": False}
        try:
            # Ray itself asks an address that nobody answers at for many minutes.
            _reach(address)
            self._ray.init(address or "local", log_to_driver=False, logging_level="ERROR", **here)
        except (OSError, ValueError, RuntimeError) as error:
            reason = (str(error).splitlines() or [""])[0]
            raise RequestError(
                f"No Ray cluster can be joined at {address or 'this machine'} ({reason}); type "
                "--address HOST:6379 of one that ray start --head began."
            ) from None

    def _room(self, gpus_per_task: float) -> int:
        """Returns how many tasks the cluster has room for."""
        there = self._ray.cluster_resources()
        room = int(there.get("CPU", 0))
        if gpus_per_task:
            gpus = there.get("GPU", 0)
            if gpus < gpus_per_task:
                raise RequestError(
                    f"--gpus-per-task {gpus_per_task:g}: the cluster has {gpus:g} GPUs; type less, "
                    "or 0 for none."
                )
            room = min(room, int(gpus / gpus_per_task))
        return max(1, room)

    def _progress(self, runs: Sequence[RunSettings], seen: dict[str, str]) -> Iterator[Message]:
        """Gives the last committed episode of each run, if there is a new one."""
        for run in runs:
            with contextlib.suppress(WorkError):
                record = self._results.find("run", run.id)
                if record is None or seen.get(run.id) == record.manifest.updated:
                    continue
                seen[run.id] = record.manifest.updated
                parts = record.parts("episodes")
                if parts:
                    (last,) = (
                        record.read_part(parts[-1], schema.EPISODES)
                        .slice(parts[-1].rows - 1)
                        .to_pylist()
                    )
                    told = {name: last[name] for name in ("control_steps", "episode_return")}
                    yield {"run": run.id, **told}

    def _outcome(self, runs: Sequence[RunSettings], task: Any) -> Iterator[Message]:
        """Gives what a task has come to; nothing where it is lost."""
        try:
            ended: list[Message] = json.loads(self._ray.get(task))
        except self._ray.exceptions.RayTaskError as error:
            reason = (str(error.cause).splitlines() or [""])[0]
            ended = [{"run": run.id, "failed": f"its task can't go on: {reason}"} for run in runs]
        except self._ray.exceptions.RayError:
            return
        by_id = {run.id: run for run in runs}
        for message in ended:
            if "finished" in message and not self._arrived(by_id[message["run"]]):
                yield {
                    "run": message["run"],
                    "failed": f"it is finished where it ran, but not in {self._results.path} here; "
                    "all nodes must share that directory",
                }
            else:
                yield message

    def _arrived(self, run: RunSettings) -> bool:
        """Returns whether the results show a run as finished, be it after a while."""
        deadline = time.monotonic() + _SEEN_WITHIN
        while run_status(run, self._results).state != "finished":
            if time.monotonic() > deadline or self._stopped.wait(_LOOK_EVERY):
                return False
        return True


def _reach(address: str | None) -> None:
    """Connects to an address once, if it is one and no word of Ray's.

    Raises:
        OSError, ValueError: if nobody answers there, or it is none.
    """
    if address is not None and address not in ("auto", "local"):
        host, _, port = address.removeprefix("ray://").rpartition(":")
        socket.create_connection((host, int(port)), _ANSWERS_WITHIN).close()


def train_batch(request: str) -> str:
    """Trains runs in a process of the node that Ray calls this on.

    Args:
        request: JSON, as `worker_request` returns it.

    Returns:
        JSON: the last message of each run that had one.
    """
    asked = json.loads(request)
    path = Path(asked["results"])
    runs = [RunSettings(**settings) for settings in asked["runs"]]
    # The sweep holds it: who does not see that is elsewhere, or could write what others write.
    if not path.is_dir() or not locks.is_shared(path):
        reason = (
            f"on the node {platform.node()}, {path} is not the sweep's, or its locks are not seen "
            "there: all nodes must share it, with flock (docs/sweeps.md)"
        )
        return json.dumps([{"run": run.id, "failed": reason} for run in runs])
    messages = Local(Results(path), device=asked["device"]).run(request)
    return json.dumps([m for m in messages if "failed" in m or "finished" in m])


def _imported() -> Any:
    try:
        import ray
        import ray.exceptions
    except ImportError:
        raise RequestError(
            "--executor ray needs Ray; pip install 'jbench[cluster]' gets it."
        ) from None
    return ray
