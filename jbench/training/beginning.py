"""Where a run begins: at its own checkpoint, at that of a shorter run, or at control step 0."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.code import code_of
from jbench.store.files import UnreadableError
from jbench.store.provenance import describe_changes, process_provenance
from jbench.store.weights import check_encoder, encoder_weights
from jbench.training.checkpoints import Checkpoint, CopiedState, copied, load
from jbench.training.code import check_run_code
from jbench.training.continuation import continued_runs, obstacle
from jbench.training.events import Report, Resumed
from jbench.training.log import RunLog
from jbench.training.member import Member
from jbench.training.recomputed import RecomputedRows, recomputed_note


@dataclass(frozen=True)
class _Source:
    """What a run resumes from.

    Attributes:
        record: of the run whose checkpoint it is.
        log: of the run at the checkpoint; None if it is another run's record.
        rows: of its replay buffer, if they had to be computed again.
        copy: what the record of another run gets of it; None if it is the run's own record.
    """

    record: Record
    log: RunLog | None
    checkpoint: Checkpoint
    rows: Tensor | None
    copy: CopiedState | None


class Beginnings:
    """Makes the members of a batch, each with the record and the log of its run."""

    def __init__(
        self,
        results: Results,
        encoders: Results,
        made_on: Mapping[str, Any],
        recomputed: RecomputedRows,
        report: Report,
    ) -> None:
        """Begins nothing yet.

        Args:
            results: get the records of the runs.
            encoders: where their encoders are.
            made_on: provenance of the machine, the task and the code.
            recomputed: rows of replay buffers.
            report: called for each run that resumes.
        """
        self._results = results
        self._encoders = encoders
        self._made_on = made_on
        self._recomputed = recomputed
        self._report = report

    def begin(self, run: RunSettings, encoder: Encoder | None, record: Record | None) -> Member:
        """Returns a run to train; `record` is its own, which is not finished, if there is one.

        Raises a RequestError if its code was edited, or what it resumes had another encoder.
        """
        check_run_code(run, record, self._made_on)
        shorter = continued_runs(run, self._results)
        sources = [*shorter]
        if record is not None:
            sources.insert(0, record)

        source, refused = self._find(run, record, sources)
        if source is not None:
            return self._resume(run, encoder, source, refused)

        if record is not None or refused:
            reason = obstacle(run, finished=False)
            if reason is not None:
                refused.append(f"{reason[0].upper()}{reason[1:]}, so its runs can't be resumed.")
            continues = shorter[0].id if shorter and record is None else ""
            self._report(Resumed(run.id, 0, continues, " ".join(refused)))

        made_on = {**self._made_on, **encoder_weights(self._encoders, run.encoder)}
        record = self._results.create("run", run.id, run.values, made_on)
        return Member(run, encoder, record, RunLog(record))

    def _find(
        self, run: RunSettings, record: Record | None, sources: Sequence[Record]
    ) -> tuple[_Source | None, list[str]]:
        """Returns the first source with an intact checkpoint, and sentences on those refused."""
        refused: list[str] = []
        for source in sources:
            checkpoint, damaged = load(source)
            refused += damaged
            if checkpoint is None:
                continue

            check_encoder(source, self._encoders)
            rows = self._recomputed.take(run, source, checkpoint)
            try:
                if source is record:
                    log = RunLog(source, checkpoint.position)
                    copy = None
                else:
                    log = None
                    copy = copied(checkpoint, source, run.id, rows)
            except UnreadableError:
                raise  # the rows may be intact: keep them
            except WorkError as error:
                refused.append(f"{error.reason}.")
                continue
            return _Source(source, log, checkpoint, rows, copy), refused

        return None, refused

    def _resume(
        self, run: RunSettings, encoder: Encoder | None, source: _Source, refused: Sequence[str]
    ) -> Member:
        """Returns a run at the checkpoint of a source, and notes in its record that it resumes."""
        position = source.checkpoint.position
        where: dict[str, Any] = {"control_steps": position.control_steps}
        record = source.record
        continues = ""
        if source.copy is not None:
            continues = record.id
            where["run"] = continues
            # The rows were made there and then, but by another command.
            before = {**record.manifest.provenance, "command": process_provenance()["command"]}
            record = self._results.create("run", run.id, run.values, before)
            record.append(source.copy.tables, source.copy.files)

        log = source.log or RunLog(record, position)
        if run.accepted is not None:
            where["code"] = code_of(self._made_on)
        changed = record.resume({**where, **recomputed_note(source.rows)}, self._made_on)

        sentences = list(refused)
        if changed:
            sentences.append(
                f"Since it began, {describe_changes(changed)}: results may differ from those of "
                "an uninterrupted run."
            )
        steps = position.control_steps
        self._report(Resumed(run.id, steps, continues, " ".join(sentences)))
        checkpoint = source.checkpoint._replace(compact=None)
        return Member(run, encoder, record, log, checkpoint, steps)
