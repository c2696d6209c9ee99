"""A cell: the runs of one task, algorithm and representation."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from jbench.encoders.settings import EncoderSettings
from jbench.names import Base
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings


class Cell(NamedTuple):
    """Runs that differ only in their seeds.

    Attributes:
        task, algo: task and algorithm of the runs.
        representation: as typed by the user: full, dae12, or the id of an encoder.
        runs: one per seed.
        settings: source of the default hyperparameters.
        encoders: settings of the runs' encoders, which are trained if they are missing; empty for
            the full observation, and for an encoder given by its id.
        dataset: training data of these encoders.
    """

    task: str
    algo: str
    representation: str
    runs: list[RunSettings]
    settings: Base
    encoders: tuple[EncoderSettings, ...] = ()
    dataset: DatasetSettings | None = None


def all_runs(cells: Sequence[Cell]) -> Iterator[RunSettings]:
    """Yields the runs of all cells, each once."""
    yield from {run.id: run for cell in cells for run in cell.runs}.values()
