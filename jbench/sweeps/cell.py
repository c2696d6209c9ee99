"""A cell: the runs of one task, algorithm and representation."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jbench.encoders.settings import EncoderSettings
from jbench.names import Base
from jbench.settings.dataset import DatasetSettings
from jbench.settings.run import RunSettings


class Cell(NamedTuple):
    """Runs that differ in their seeds alone.

    Attributes:
        task, algo: of the runs.
        representation: as the user names it: full, dae12, or the id of an encoder.
        runs: one for each seed.
        settings: whose defaults the algorithm has.
        encoder: settings of the encoder that is made if it is missing; None for the full
            observation, and for an encoder that is named by its id.
        dataset: that this encoder is trained on.
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
