"""Where the runs of a sweep go on: on this machine here, on a Ray cluster in `cluster.py`."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from jbench.experiments.settings import CHECKPOINT_EVERY, RunSettings
from jbench.experiments.train import Message, stop_workers, worker, worker_request
from jbench.store import Results


class Executor(Protocol):
    """What does batches of runs, several at a time, each called from a thread of its own."""

    @property
    def jobs(self) -> int:
        """How many batches go on at a time."""

    @property
    def device(self) -> str:
        """What the batched engine learns on, `cpu` or `cuda`."""

    def do(self, runs: Sequence[RunSettings]) -> Iterator[Message]:
        """Does runs that may share a process, and gives what their worker says.

        It ends early, with runs of which nothing was said, where their process dies.
        """

    def stop(self) -> None:
        """Ends all that is under way; what was committed is kept."""

    def close(self) -> None:
        """Gives back what was taken, when nothing is under way any more."""


class Local:
    """Processes of one thread each on this machine."""

    def __init__(
        self, results: Results, jobs: int, device: str, checkpoint_every: float = CHECKPOINT_EVERY
    ) -> None:
        """Remembers what to work with.

        Args:
            results: where the runs go.
            jobs: processes at a time.
            device: `cpu` or `cuda`.
            checkpoint_every: seconds between two checkpoints of a run, at least.
        """
        self.jobs, self.device = jobs, device
        self._results, self._checkpoint_every = results, checkpoint_every
        self._stopped = False

    def do(self, runs: Sequence[RunSettings]) -> Iterator[Message]:
        """Does the runs in a process; see `Executor`."""
        request = worker_request(runs, self._results, self.device, self._checkpoint_every)
        with worker(request) as messages:
            # One that was started while all were stopped is among nobody's victims.
            if not self._stopped:
                yield from messages

    def stop(self) -> None:
        """Kills the processes."""
        self._stopped = True
        stop_workers()

    def close(self) -> None:
        """Does nothing: a process ends with its runs."""
