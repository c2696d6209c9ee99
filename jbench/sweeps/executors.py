"""Where the runs of a sweep are trained: on this machine, or on a Ray cluster (`cluster.py`)."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from jbench.names import CHECKPOINT_EVERY
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.processes import Message, Workers, worker_request


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
        """Starts no process yet.

        Args:
            results: where the runs are written.
            jobs: processes at a time.
            device: `cpu` or `cuda`.
            checkpoint_every: least time between two checkpoints of a run (s).
        """
        self.jobs, self.device = jobs, device
        self._results, self._checkpoint_every = results, checkpoint_every
        self._workers = Workers()

    def do(self, runs: Sequence[RunSettings]) -> Iterator[Message]:
        """Trains the runs in one process; see `Executor`."""
        request = worker_request(runs, self._results, self.device, self._checkpoint_every)
        with self._workers.run(request) as messages:
            yield from messages

    def stop(self) -> None:
        """Kills the processes."""
        self._workers.stop()

    def close(self) -> None:
        """Does nothing: a process ends with its runs."""
