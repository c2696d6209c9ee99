"""What the scheduler reports while it works."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext

from jbench.settings.run import RunSettings
from jbench.sweeps.cell_status import CellStatus
from jbench.sweeps.executors import Message


class Watcher:
    """Receives the events of a sweep; the methods here do nothing.

    All are called in the thread that called `jbench.sweeps.scheduler.sweep`.
    """

    def note(self, sentence: str) -> None:
        """Something happened that a user wants to know."""

    def warn(self, sentence: str) -> None:
        """Something failed, and the sweep continues."""

    def progress(
        self, label: str, total: int, unit: str
    ) -> AbstractContextManager[Callable[[int], None]]:
        """A dataset is collected or an encoder trained.

        Returns:
            A context that lasts as long as this work, with a function that takes how much of the
            total is done.
        """
        return nullcontext(lambda done: None)

    def forecast(self, statuses: Sequence[CellStatus], jobs: int) -> None:
        """Runs will be trained on this machine, by `jobs` processes at a time.

        The statuses are of these runs alone, with the time that they will take.
        """

    def training(self, runs: Sequence[RunSettings]) -> AbstractContextManager[None]:
        """Runs are trained; returns a context that lasts until all have ended."""
        return nullcontext()

    def started(self, runs: Sequence[RunSettings]) -> None:
        """A worker starts to train these runs."""

    def message(self, run: RunSettings, message: Message) -> None:
        """A worker reports on a run; see `jbench.training.worker`."""

    def ended(self, runs: Sequence[RunSettings]) -> None:
        """The worker of these runs has ended, whether they are finished or not."""
