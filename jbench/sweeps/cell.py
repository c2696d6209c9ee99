"""A cell: the runs of one task, algorithm and representation."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jbench.encoders.settings import EncoderSettings
from jbench.names import Base
from jbench.settings.dataset import DatasetSettings
from jbench.settings.run import RunSettings


class Cell(NamedTuple):
    """Runs that differ only in their seeds.

    Attributes:
        task, algo: task and algorithm of the runs.
        representation: as typed by the user: full, dae12, or the id of an encoder.
        runs: one per seed.
        settings: source of the default hyperparameters.
        encoder: settings of the encoder, which is trained if it is missing; None for the full
            observation, and for an encoder given by its id.
        dataset: training data of this encoder.
    """

    task: str
    algo: str
    representation: str
    runs: list[RunSettings]
    settings: Base
    encoder: EncoderSettings | None = None
    dataset: DatasetSettings | None = None


def all_runs(cells: Sequence[Cell]) -> Iterator[RunSettings]:
    """Yields the runs of all cells, each once."""
    yield from {run.id: run for cell in cells for run in cell.runs}.values()
