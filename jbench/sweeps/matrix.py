"""A matrix of runs: tasks, algorithms, representations and seeds, read from a TOML file.

A file may consist of several parts, each a matrix. A run's id depends only on the file: `dae12`
is the encoder with the file's dataset and options, even if the results contain newer ones, so the
same matrix always gives the same runs.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    NonNegativeInt,
    PrivateAttr,
)

from jbench.agents.algorithms import algorithm_fields, check_name, settings_of
from jbench.encoders.registry import Wanted, find_kind, kind_names, wanted_encoder
from jbench.encoders.settings import EncoderSettings, encoder_settings
from jbench.errors import RequestError
from jbench.names import (
    FULL,
    OFE,
    Base,
    Engine,
    Precision,
    TimeLimit,
    evaluation_interval,
    known,
)
from jbench.seeds import parse_seeds
from jbench.settings.algorithms import base_of
from jbench.settings.base import Count, Seed, Settings, in_id, validated, whole
from jbench.settings.records import DatasetSettings
from jbench.settings.run import RunSettings
from jbench.simulation.find import dataset_robot, find_task
from jbench.store import Results
from jbench.sweeps.cell import Cell
from jbench.sweeps.matrix_file import (
    COMPARISON,
    PART,
    check_keys,
    choices,
    named,
    parts_of,
    read_content,
)
from jbench.training.request import (
    check_options,
    representation_of,
    requested_ofe,
    runs_of,
)

# TOML parses 5e6 as a float.
_Count = Annotated[Count, BeforeValidator(whole)]
_EachOnce = AfterValidator(lambda seeds: tuple(dict.fromkeys(seeds)))
# TOML has lists; tuples are immutable.
_Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]


def _like_run(name: str) -> Any:
    """Returns a field with the default and the limits of a field of `RunSettings`."""
    return RunSettings.model_fields[name]


class Evaluation(Settings):
    """The table [evaluation]."""

    every: _Count | None = Field(
        default=None,
        description="control steps between evaluations; default: a tenth of the steps, at most "
        "50,000",
    )
    episodes: NonNegativeInt = Field(default=10, description="per evaluation; 0 for none")


class DatasetPart(Settings):
    """The table [dataset]: the dataset on which missing encoders are trained."""

    steps: _Count = Field(default=5_000_000, description="control steps; paper, section 5.2")
    seed: Seed = 0


class EncoderPart(Settings):
    """The table [encoder]: how missing encoders are trained."""

    seed: Seed | Literal["each"] = Field(
        default=0, description="of all encoders, or each: the seed of the agent"
    )
    options: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="options by kind that differ from the defaults"
    )


class Matrix(Settings):
    """Content of a file, or of a part of it; `docs/sweeps.md` lists the keys.

    A key with the name or title of a field of `RunSettings` is that setting of all runs.
    """

    tasks: _Names
    algos: _Names
    representations: _Names = (FULL,)
    seeds: Annotated[tuple[Seed, ...], _EachOnce] = Field(
        default=tuple(range(10)), strict=False, min_length=1
    )
    steps: _Count = Field(default=5_000_000, description="control steps; paper, section 5.1")
    engine: Engine | None = Field(
        default=None, description="default: batched, or the only engine of the algorithm"
    )
    precision: Precision = _like_run("precision")
    environments: int | None = _like_run("parallel")
    time_limit: TimeLimit = _like_run("time_limit")
    augment: Seed | None = _like_run("augment")
    robots: int = _like_run("robots")
    settings: Base | None = Field(
        default=None,
        description="source of default hyperparameters; default: published, and suite for other "
        "robots",
    )
    hyperparameters: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="hyperparameters by algorithm that replace the defaults"
    )
    evaluation: Evaluation = Evaluation()
    dataset: DatasetPart = DatasetPart()
    encoder: EncoderPart = EncoderPart()
    ofe: dict[str, Any] = Field(
        default_factory=dict, description="settings of ofeN that replace the defaults"
    )
    _name: str = PrivateAttr("the matrix")  # of the file or part, for errors

    @property
    def run_fields(self) -> dict[str, Any]:
        """Fields of `RunSettings` that are the same in all runs."""
        names = {name: field.title or name for name, field in RunSettings.model_fields.items()}
        fields = {
            name: getattr(self, key) for name, key in names.items() if key in Matrix.model_fields
        }
        return fields | {
            "evaluate_every": self.evaluation.every or evaluation_interval(self.steps),
            "evaluate_episodes": self.evaluation.episodes,
        }

    def dataset_settings(self, task: str) -> DatasetSettings:
        """Returns the settings of the dataset of a task's encoders."""
        numbers = {"steps": self.dataset.steps, "seed": self.dataset.seed}
        robot = dataset_robot(find_task(task))
        return validated(DatasetSettings, "[dataset]", **numbers, **robot)


def read_matrix(name: str, **changes: Any) -> list[Matrix]:
    """Returns the parts of a matrix; a file without parts has one.

    Args:
        name: one of `jbench.names.SWEEPS`, or the path of a .toml file.
        changes: keys that replace the file's in all parts.

    Raises:
        RequestError: if there is no such matrix, or it is invalid.
    """
    content = read_content(name)
    with named(name):
        for key in content:
            known("key", key, (*Matrix.model_fields, PART, COMPARISON))
    parts = [_matrix({**part, **changes}, where) for where, part in parts_of(content, name).items()]
    trained = {algo for part in parts for algo in part.algos}
    for algo in (algo for part in parts for algo in part.hyperparameters if algo not in trained):
        raise RequestError(
            f"{name}: [hyperparameters.{algo}] is for {algo}, which is not among the algos; leave "
            "the table out, or add it to them."
        )
    engines = sorted({part.engine or "batched" for part in parts})
    if len(engines) > 1:
        raise RequestError(f"{name}: all parts need the same engine, not {' and '.join(engines)}.")
    return parts


def matrix_cells(parts: Sequence[Matrix], results: Results) -> list[Cell]:
    """Returns the cells of the parts of a matrix in the order of the file, grouped by task.

    Args:
        results: results that contain the encoders given by id.

    Raises:
        RequestError: if the settings of a run or an encoder are invalid.
    """
    # Cells may be repeated, also by another name: planar is planar12.
    different: dict[tuple[str, ...], Cell] = {}
    for part in parts:
        with named(part._name):
            for task, algo, name in product(part.tasks, part.algos, part.representations):
                if "/" not in name or name.split("/")[0] == in_id(task):
                    cell = _cell(part, results, task, algo, name)
                    different.setdefault(tuple(run.id for run in cell.runs), cell)
    return list(different.values())


def _matrix(content: Mapping[str, Any], name: str) -> Matrix:
    """Returns the checked content of a file or part."""
    with named(name):
        check_keys(Matrix, content)
        for key, field in Matrix.model_fields.items():
            allowed = choices(field.annotation)
            if allowed and isinstance(content.get(key), str):
                known(key, content[key], allowed)
        seeds = content.get("seeds")
        given = {"seeds": parse_seeds(seeds, "seeds")} if isinstance(seeds, str) else {}
        matrix = validated(Matrix, "the matrix", **{**content, **given})
        _check_names(matrix)
    matrix._name = name
    return matrix


def _check_names(matrix: Matrix) -> None:
    """Raises a RequestError if a name is unknown."""
    for task in matrix.tasks:
        find_task(task)
    for algo in (*matrix.algos, *matrix.hyperparameters):
        check_name(algo)
    for algo, overrides in matrix.hyperparameters.items():
        names = tuple(settings_of(algo)) if overrides else ()
        for key in overrides:
            known(f"setting of {algo}", key, names)
    check_options(matrix.ofe)
    for kind, options in matrix.encoder.options.items():
        for key in options:
            known(f"option of {kind}", key, tuple(find_kind(kind).model_fields))
    for name in matrix.representations:
        task, slash, _ = name.partition("/")
        if slash and task not in map(in_id, matrix.tasks):
            raise RequestError(f"the encoder {name} is of {task}, which is not among the tasks.")
        if not slash and name != FULL and requested_ofe(name, matrix.ofe) is None:
            for each in matrix.tasks:
                _wanted(name, each)


def _wanted(name: str, task: str) -> Wanted:
    """Returns the encoder of a representation such as dae12, dae12-observation or planar."""
    encoder = wanted_encoder(name, task)
    if encoder is None:
        known("representation", name, (FULL, *(f"{kind}12" for kind in (*kind_names(), OFE))))
    assert encoder is not None
    return encoder


def _cell(matrix: Matrix, results: Results, task: str, algo: str, name: str) -> Cell:
    overrides = matrix.hyperparameters.get(algo)
    fields = matrix.run_fields | {
        **algorithm_fields(algo, matrix.engine, matrix.settings, overrides, task),
        "task": task,
        "specs": find_task(task).specs,
        "encoder": None,
        "ofe": requested_ofe(name, matrix.ofe),
    }
    encoders: dict[int, EncoderSettings] = {}
    dataset = None
    if fields["ofe"] is not None:
        fields["representation"] = fields["ofe"].representation
    elif "/" in name:
        fields |= {"encoder": name, "representation": representation_of(results, name)}
    elif name != FULL:
        dataset = matrix.dataset_settings(task)
        encoders = _encoders(matrix, dataset, task, _wanted(name, task))
        first = encoders[matrix.seeds[0]]
        fields["representation"] = first.representation
        if matrix.encoder.seed == "each":
            fields["encoder_draws"] = first.draws
    runs = runs_of(matrix.seeds, {seed: e.id for seed, e in encoders.items()}, **fields)
    different = tuple({encoder.id: encoder for encoder in encoders.values()}.values())
    return Cell(task, algo, name, runs, base_of(task, matrix.settings), different, dataset)


def _encoders(
    matrix: Matrix, dataset: DatasetSettings, task: str, wanted: Wanted
) -> dict[int, EncoderSettings]:
    """Returns the encoder of each seed."""
    options = {**matrix.encoder.options.get(wanted.kind, {}), **wanted.options}
    seed = matrix.encoder.seed
    return {
        agent_seed: encoder_settings(
            wanted.kind,
            options,
            task=task,
            dataset=dataset.id,
            latents=wanted.latents,
            seed=agent_seed if seed == "each" else seed,
        )
        for agent_seed in matrix.seeds
    }
