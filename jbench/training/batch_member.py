"""A run of a batch: its record, its rows and the checkpoint from which it resumes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.files import UnreadableError
from jbench.store.provenance import sentence_of
from jbench.training.checkpoints import Checkpoint, load
from jbench.training.engines import restart_reason
from jbench.training.log import RunLog

Notice = Callable[[RunSettings, int, str], None]
"""Called for each resumed run with the run, its control steps so far, and a sentence."""


@dataclass
class Member:
    """A run of a batch.

    Attributes:
        control_steps: at which it is, or resumes from its checkpoint.
    """

    settings: RunSettings
    encoder: Encoder | None
    record: Record
    log: RunLog
    checkpoint: Checkpoint | None = None
    control_steps: int = 0

    def is_behind(self, until: int | None) -> bool:
        """Returns whether it is unfinished and has not reached this control step."""
        return self.record.status == "unfinished" and (until is None or self.control_steps < until)


def begin(
    run: RunSettings,
    encoder: Encoder | None,
    record: Record | None,
    results: Results,
    made_on: Mapping[str, str | None],
    notice: Notice,
) -> Member | None:
    """Returns a run to train from its last checkpoint or from scratch; None if it is finished."""
    if record is not None and record.status == "finished":
        return None
    if record is not None:
        checkpoint, refused = load(record)
        try:
            log = None if checkpoint is None else RunLog(record, checkpoint.position)
        except UnreadableError:
            raise  # the rows may be intact: keep them
        except WorkError as error:  # rows are damaged
            log, refused = None, [str(error).partition(";")[0] + "."]
        if checkpoint is not None and log is not None:
            steps = checkpoint.position.control_steps
            changed = record.resume({"control_steps": steps}, made_on)
            if changed:
                refused.append(
                    f"Since it began, {sentence_of(changed)}: results may differ from those of an "
                    "uninterrupted run."
                )
            notice(run, steps, " ".join(refused))
            return Member(run, encoder, record, log, checkpoint, steps)
        notice(run, 0, " ".join([*refused, *restart_reason(run)]))
    record = results.create("run", run.id, run.values, made_on)
    return Member(run, encoder, record, RunLog(record))
