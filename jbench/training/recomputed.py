"""The replay buffers of compact states that the runs of a batch continue."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from torch import Tensor

from jbench.encoders import Encoder
from jbench.settings.recorded import read_run
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.training.checkpoints import Checkpoint, load
from jbench.training.compact import (
    RECOMPUTED,
    CompactReplay,
    can_share,
    computed_again,
    other_rows_error,
)
from jbench.training.continuation import continued_runs
from jbench.training.events import Note, Report
from jbench.wording import counted


class _Kept(NamedTuple):
    """A finished run, and the compact state that it has kept."""

    record: Record
    replay: CompactReplay


class RecomputedRows:
    """Rows of replay buffers, computed again when they are first asked for.

    Those of all new runs of a batch are computed together, since their robots are stepped together.
    """

    def __init__(
        self,
        runs: Sequence[RunSettings],
        results: Results,
        load_encoder: Callable[[str | None], Encoder | None],
        device: str,
        report: Report,
    ) -> None:
        """Computes nothing yet."""
        self._runs = runs
        self._results = results
        self._load_encoder = load_encoder
        self._device = device
        self._report = report
        self._rows: dict[str, Tensor | None] = {}

    def take(self, run: RunSettings, source: Record, checkpoint: Checkpoint) -> Tensor | None:
        """Returns the rows (environments, rows, width) of a finished run that `run` continues.

        None if its state is not compact. Raises an OtherRowsError if they are not those of the run.
        """
        replay = checkpoint.compact
        if replay is None:
            return None
        if source.id not in self._rows:
            self._compute(run, [_Kept(source, replay), *self._others(source, replay)])
        rows = self._rows.pop(source.id)
        if rows is None:
            raise other_rows_error(source)
        return rows

    def _others(self, source: Record, replay: CompactReplay) -> Iterator[_Kept]:
        """Yields the states of other new runs that can be computed beside the one of `source`."""
        for run in self._runs:
            if self._results.has("run", run.id):
                continue
            for record in continued_runs(run, self._results)[:1]:
                checkpoint, _ = load(record)
                if record.id == source.id or checkpoint is None or checkpoint.compact is None:
                    continue
                if can_share(checkpoint.compact, replay):
                    yield _Kept(record, checkpoint.compact)

    def _compute(self, run: RunSettings, kept: Sequence[_Kept]) -> None:
        """Computes the rows of all these states at once, and keeps them until they are taken."""
        steps = len(kept[0].replay.actions) * run.environments
        sentence = (
            f"The replay buffers of {counted(len(kept), 'run')} are computed again from "
            f"{steps:,} actions each."
        )
        self._report(Note(sentence))
        runs = [read_run(each.record.settings) for each in kept]
        sources = [each for each in runs if isinstance(each, RunSettings)]
        rows = computed_again(
            sources,
            [self._load_encoder(each.encoder) for each in sources],
            [each.replay for each in kept],
            self._device,
        )
        ids = (each.record.id for each in kept)
        self._rows |= dict(zip(ids, rows, strict=True))


def recomputed_note(rows: Tensor | None) -> dict[str, int]:
    """Returns what a record notes of rows that were computed again, where it is continued."""
    if rows is None:
        return {}
    return {RECOMPUTED: rows.shape[1]}
