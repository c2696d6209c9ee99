"""Cells: the runs of one task, algorithm and representation, and those of a matrix.

A run's id depends only on the file of the matrix: `dae12` is the encoder with the file's dataset
and options, even if the results contain newer ones, so the same matrix always gives the same runs.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

from jbench.agents.algorithms import algorithm_fields
from jbench.encoders.registry import EncoderSettings, encoder_settings, kind_names, named_encoder
from jbench.errors import RequestError
from jbench.names import FULL, OFE, Base, known
from jbench.settings.algorithms import default_base
from jbench.settings.base import in_id, validated
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.simulation.find import dataset_robot, find_task
from jbench.store import Results
from jbench.sweeps.matrix import Matrix, named
from jbench.training.request import make_runs, read_representation, requested_ofe


class Cell(NamedTuple):
    """Runs that differ only in their seeds; `settings` is the source of their hyperparameters.

    The representation is as typed: full, dae12, or the id of an encoder. `encoders` are the
    settings of the runs' encoders, which are trained on the dataset if they are missing; empty for
    the full observation, and for an encoder given by its id.
    """

    task: str
    algo: str
    representation: str
    runs: list[RunSettings]
    settings: Base
    encoders: tuple[EncoderSettings, ...] = ()
    dataset: DatasetSettings | None = None


def all_runs(cells: Sequence[Cell]) -> Iterator[RunSettings]:
    """Yields the runs of all cells once."""
    yield from {run.id: run for cell in cells for run in cell.runs}.values()


def with_runs(cells: Iterable[Cell], ids: Collection[str]) -> list[Cell]:
    """Returns the cells that have some of these runs, each with no others."""
    chosen = (cell._replace(runs=[run for run in cell.runs if run.id in ids]) for cell in cells)
    return [cell for cell in chosen if cell.runs]


def matrix_cells(parts: Sequence[Matrix], results: Results) -> list[Cell]:
    """Returns the cells of the parts of a matrix in the order of the file, grouped by task.

    The results contain the encoders given by id. Raises a RequestError if the settings of a run or
    an encoder are invalid.
    """
    # Cells may be repeated, also by another name: planar is planar12.
    different: dict[tuple[str, ...], Cell] = {}
    for part in parts:
        with named(part._name):
            for name in part.representations:
                task, slash, _ = name.partition("/")
                if slash and task not in map(in_id, part.tasks):
                    raise RequestError(f"the encoder {name} is of {task}, which is not in tasks.")
            for task, algo, name in product(part.tasks, part.algos, part.representations):
                if "/" not in name or name.split("/")[0] == in_id(task):
                    cell = _cell(part, results, task, algo, name)
                    different.setdefault(tuple(run.id for run in cell.runs), cell)
    return list(different.values())


def _cell(matrix: Matrix, results: Results, task: str, algo: str, name: str) -> Cell:
    overrides = matrix.hyperparameters.get(algo)
    fields = matrix.run_fields | {
        **algorithm_fields(algo, matrix.engine, matrix.settings, overrides, task),
        "task": task,
        "specs": find_task(task).specs,
        "encoder": None,
        "ofe": requested_ofe(name, matrix.ofe),
    }
    encoders: dict[int, EncoderSettings] = {}  # by the agent's seed
    dataset = None
    if fields["ofe"] is not None:
        fields["representation"] = fields["ofe"].representation
    elif "/" in name:
        fields |= {"encoder": name, "representation": read_representation(results, name)}
    elif name != FULL:
        robot = dataset_robot(find_task(task))
        dataset = validated(DatasetSettings, "[dataset]", **matrix.dataset.model_dump(), **robot)
        encoder, draws = _encoder(matrix, task, name, dataset), matrix.encoder.seed == "each"
        encoders = {
            seed: encoder.model_copy(update={"seed": seed}) if draws else encoder
            for seed in matrix.seeds
        }
        fields["representation"] = encoder.representation
        fields["encoder_draws"] = encoder.draws if draws else None
    runs = make_runs(matrix.seeds, {seed: e.id for seed, e in encoders.items()}, **fields)
    different = tuple({encoder.id: encoder for encoder in encoders.values()}.values())
    return Cell(task, algo, name, runs, default_base(task, matrix.settings), different, dataset)


def _encoder(matrix: Matrix, task: str, name: str, dataset: DatasetSettings) -> EncoderSettings:
    """Returns the settings of the encoder with the seed of the file, or the seed 0."""
    wanted = named_encoder(name, task)
    if wanted is None:
        known("representation", name, (FULL, *(f"{kind}12" for kind in (*kind_names(), OFE))))
    assert wanted is not None
    return encoder_settings(
        wanted.kind,
        {**matrix.encoder.options.get(wanted.kind, {}), **wanted.options},
        task=task,
        dataset=dataset.id,
        latents=wanted.latents,
        seed=0 if matrix.encoder.seed == "each" else matrix.encoder.seed,
    )
