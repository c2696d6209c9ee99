"""Events of a sweep."""

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
        """Reports something of interest to the user."""

    def warn(self, sentence: str) -> None:
        """Reports a failure after which the sweep continues."""

    def progress(
        self, label: str, total: int, unit: str
    ) -> AbstractContextManager[Callable[[int], None]]:
        """Called when a dataset is collected or an encoder is trained.

        Returns:
            A context manager for the duration of this work; it yields a function that takes how
            much of the total is done.
        """
        return nullcontext(lambda done: None)

    def forecast(self, statuses: Sequence[CellStatus], jobs: int) -> None:
        """Called before `jobs` processes at a time train runs on this machine.

        The statuses cover only these runs, with the estimated time.
        """

    def training(self, runs: Sequence[RunSettings]) -> AbstractContextManager[None]:
        """Returns a context manager for the duration of the training."""
        return nullcontext()

    def started(self, runs: Sequence[RunSettings]) -> None:
        """Called when a worker starts to train these runs."""

    def message(self, run: RunSettings, message: Message) -> None:
        """Called when a worker reports on a run; see `jbench.training.worker`."""

    def ended(self, runs: Sequence[RunSettings]) -> None:
        """Called when the worker of these runs has ended, whether they are finished or not."""
