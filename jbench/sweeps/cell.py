"""Cells: the runs of one task, algorithm and representation; those of a matrix.

A run's id depends only on the file of the matrix: `dae12` is the encoder with the file's dataset
and options, even if the results contain newer ones, so the same matrix always gives the same runs.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

from jbench.datasets import plan_dataset
from jbench.encoders.find import kept_settings
from jbench.encoders.registry import kind_names, make_kind
from jbench.encoders.representations import named_encoder
from jbench.encoders.settings import EncoderSettings, encoder_settings
from jbench.encoders.training import plan_encoder
from jbench.names import SettingsBase
from jbench.representation_names import FULL, OFE
from jbench.settings.base import validated
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.studies.arms import Arm, arms
from jbench.studies.file import refusals_named
from jbench.studies.matrix import Matrix, Parts
from jbench.tasks.find import find_task
from jbench.training.code import plan_runs
from jbench.training.kept_evaluations import with_kept_evaluations
from jbench.training.request import make_runs, read_representation
from jbench.typed_values import known


@dataclass(frozen=True)
class Cell:
    """Runs that differ only in their seeds.

    Attributes:
        representation: as typed: full, dae12, or the id of an encoder.
        base: the source of the hyperparameters.
        encoders: settings of the runs' encoders, which are trained on the dataset if they are
            missing; empty for the full observation, and for an encoder given by its id.
        arms: the arms of a study whose runs these are, if any: several, if parts repeat them.
        notes: sentences on recorded runs of other code.
    """

    task: str
    algo: str
    representation: str
    runs: list[RunSettings]
    base: SettingsBase
    encoders: tuple[EncoderSettings, ...] = ()
    dataset: DatasetSettings | None = None
    arms: tuple[Arm, ...] = field(default=(), compare=False)
    notes: tuple[str, ...] = ()


def all_runs(cells: Sequence[Cell]) -> list[RunSettings]:
    """Returns the runs of all cells, each once."""
    return list({run.id: run for cell in cells for run in cell.runs}.values())


def with_runs(cells: Iterable[Cell], ids: Collection[str]) -> list[Cell]:
    """Returns the cells that have some of these runs, each with no others."""
    chosen = (replace(cell, runs=[run for run in cell.runs if run.id in ids]) for cell in cells)
    return [cell for cell in chosen if cell.runs]


def matrix_cells(parts: Parts, results: Results, accept_changed: bool = False) -> list[Cell]:
    """Returns the cells of the parts of a matrix in the order of the file, grouped by task.

    The results contain the encoders given by id; see `plan_runs` for `accept_changed`. Raises a
    RequestError if the settings of a run or an encoder are invalid.
    """
    for where, part in parts.items():
        with refusals_named(where):
            for kind, options in part.encoder.options.items():
                make_kind(kind, options)  # which checks them, also if unused

    # Arms may have the same runs, also by another name: planar is planar12.
    cells: dict[tuple[str, ...], Cell] = {}
    for arm in arms(parts):
        with refusals_named(arm.where):
            cell = _cell(arm, results, accept_changed)
        ids = tuple(run.id for run in cell.runs)
        if ids in cells:
            cell = replace(cells[ids], arms=(*cells[ids].arms, arm))
        cells[ids] = cell

    return list(cells.values())


def _cell(arm: Arm, results: Results, accept_changed: bool) -> Cell:
    """Returns the runs of an arm, and the encoders and dataset that are to be made for them."""
    part = arm.part
    task = arm.task
    name = arm.representation

    fields = dict(arm.fields)
    dataset: DatasetSettings | None = None
    encoders: dict[int, EncoderSettings] = {}  # by their seeds
    drawn = part.encoder.seed == "each"
    if fields["ofe"] is not None:
        fields["representation"] = fields["ofe"].representation
    elif "/" in name:
        fields["encoder"] = name
        fields["representation"] = read_representation(results, name, accept_changed)
    elif name != FULL:
        about = find_task(task)
        robot = dataset_robot(about.name, about.specs)
        dataset = validated(DatasetSettings, "[dataset]", **dict(part.dataset), **robot)
        dataset = plan_dataset(dataset, results).settings
        encoder = kept_settings(results, _encoder(part, task, name, dataset, results))
        seeds = part.seeds if drawn else (encoder.seed,)
        encoders = {seed: encoder.model_copy(update={"seed": seed}) for seed in seeds}
        fields["encoder"] = encoder.id
        fields["representation"] = encoder.representation
        fields["encoder_draws"] = encoder.draws if drawn else None

    ids = {seed: encoder.id for seed, encoder in encoders.items()} if drawn else None
    runs = make_runs(part.seeds, ids, **fields)
    runs, notes = plan_runs(runs, results, accept_changed)
    runs = with_kept_evaluations(runs, results, part.run_fields)

    return Cell(
        task=task,
        algo=arm.algo,
        representation=name,
        runs=runs,
        base=arm.base,
        encoders=tuple(encoders.values()),
        dataset=dataset,
        arms=(arm,),
        notes=tuple(notes),
    )


def _encoder(
    part: Matrix, task: str, name: str, dataset: DatasetSettings, results: Results
) -> EncoderSettings:
    """Returns the settings of the encoder that a representation names."""
    wanted = named_encoder(name, task)
    if wanted is None:
        known("representation", name, (FULL, *(f"{kind}12" for kind in (*kind_names(), OFE))))

    assert wanted is not None
    present = encoder_settings(
        wanted.kind,
        {**part.encoder.options.get(wanted.kind, {}), **wanted.options},
        task=task,
        base=wanted.base,
        latents=wanted.latents,
        dataset=dataset.id,
        seed=0 if part.encoder.seed == "each" else part.encoder.seed,
    )
    return plan_encoder(present, results).settings
