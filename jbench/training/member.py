"""A run of a batch while it is trained."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from jbench.encoders import Encoder
from jbench.errors import WorkError, sentence_of_failure
from jbench.policies.network import SavedNetwork
from jbench.settings.run import RunSettings
from jbench.store import Record
from jbench.store.files import NoRoomError
from jbench.training.checkpoints import Checkpoint
from jbench.training.log import RunLog


@dataclass
class Member:
    """A run of a batch, at a control step, or to be resumed there.

    `evaluated` is the policy of the last evaluation, which the last updates may follow.
    """

    settings: RunSettings
    encoder: Encoder | None
    record: Record
    log: RunLog
    checkpoint: Checkpoint | None = None
    control_steps: int = 0
    evaluated: SavedNetwork | None = None
    failure: Exception | None = None

    @property
    def is_unfinished(self) -> bool:
        """Whether the run has neither finished nor failed."""
        return self.failure is None and self.record.status == "unfinished"

    def is_due(self, until: int | None) -> bool:
        """Returns whether the run is to be trained up to a control step, or to the end (None)."""
        is_before = until is None or self.control_steps < until
        return self.is_unfinished and is_before

    @contextlib.contextmanager
    def failing_alone(self) -> Iterator[None]:
        """Fails the run if its record can't be written, such as one that was removed.

        The other runs of the batch go on.
        """
        try:
            yield
        except WorkError as error:
            self.fail(error)

    def fail(self, error: Exception) -> None:
        """Records an error that ended the training, as far as its record can be written.

        A full disk does not fail the run: once there is room, the same command resumes it.
        """
        self.failure = error
        with contextlib.suppress(WorkError):
            self.log.commit()
        if isinstance(error, NoRoomError):
            return
        with contextlib.suppress(WorkError):
            self.record.fail(sentence_of_failure(error))
