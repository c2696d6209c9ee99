"""A run of a batch: its record, its rows and the checkpoint from which it resumes."""

from collections.abc import Mapping
from dataclasses import dataclass

from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.flaws import UnreadableError
from jbench.store.provenance import describe_changes, provenance
from jbench.training.checkpoints import Checkpoint, copied, load
from jbench.training.continuation import kept_runs, without_state
from jbench.training.events import Event, Report
from jbench.training.log import RunLog


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
    report: Report,
) -> Member | None:
    """Returns a run to train from a checkpoint or from scratch; None if it is finished.

    The checkpoint is its own last one, or that of the longest run that it can continue.
    """
    if record is not None and record.status == "finished":
        return None
    refused: list[str] = []
    if record is not None:
        member = _resumed(run, encoder, record, made_on, report, refused)
        if member is not None:
            return member
    shorter = kept_runs(run, results)
    for other in shorter:
        copy = _copy(run, other, results, refused)
        if copy is not None:
            return _resumed(run, encoder, copy, made_on, report, refused, other.id)
    if record is not None or refused:
        if reason := without_state(run):
            refused.append(f"{reason[0].upper()}{reason[1:]}, so its runs can't be resumed.")
        sentence = " ".join(refused)
        continues = shorter[0].id if shorter and record is None else ""
        report(Event("resumed", run.id, sentence, continues=continues))
    record = results.create("run", run.id, run.values, made_on)
    return Member(run, encoder, record, RunLog(record))


def _resumed(
    run: RunSettings,
    encoder: Encoder | None,
    record: Record,
    made_on: Mapping[str, str | None],
    report: Report,
    refused: list[str],
    continues: str = "",
) -> Member | None:
    """Returns a run to train from the last checkpoint in its record; None if there is none.

    Args:
        refused: sentences on checkpoints that can't be used, to which this adds.
        continues: id of the finished run with this checkpoint; empty if it is its own.
    """
    checkpoint, damaged = load(record)
    refused += damaged
    if checkpoint is None:
        return None
    try:
        log = RunLog(record, checkpoint.position)
    except UnreadableError:
        raise  # the rows may be intact: keep them
    except WorkError as error:  # rows are damaged
        refused[:] = [_reason(error)]
        return None
    steps = checkpoint.position.control_steps
    other_run = {"run": continues} if continues else {}
    changed = record.resume({"control_steps": steps, **other_run}, made_on)
    if changed:
        refused.append(
            f"Since it began, {describe_changes(changed)}: results may differ from those of an "
            "uninterrupted run."
        )
    report(Event("resumed", run.id, " ".join(refused), steps, continues=continues))
    return Member(run, encoder, record, log, checkpoint, steps)


def _copy(run: RunSettings, shorter: Record, results: Results, refused: list[str]) -> Record | None:
    """Writes a record that begins like a shorter run; returns None if that run is damaged."""
    checkpoint, damaged = load(shorter)
    refused += damaged
    if checkpoint is None:
        return None
    try:
        tables, files = copied(checkpoint, shorter, run.id)
    except UnreadableError:
        raise
    except WorkError as error:
        refused.append(_reason(error))
        return None
    # The rows were made there and then, but by another command.
    made_on = {**shorter.manifest.provenance, "command": provenance()["command"]}
    record = results.create("run", run.id, run.values, made_on)
    record.append(tables, files)
    return record


def _reason(error: WorkError) -> str:
    return str(error).partition(";")[0] + "."
