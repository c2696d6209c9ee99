"""A matrix of runs: tasks, algorithms, representations and seeds, read from a TOML file.

A file may consist of several parts, each a matrix. A run's id depends only on the file: `dae12`
is the encoder with the file's dataset and options, even if the results contain newer ones, so the
same matrix always gives the same runs.
"""

from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, create_model

from jbench.agents.algorithms import algorithm_fields
from jbench.encoders.registry import kind_names, make_kind
from jbench.encoders.settings import EncoderSettings, encoder_settings, named_encoder
from jbench.errors import RequestError
from jbench.names import FULL, OFE, Base, evaluation_interval, known
from jbench.seeds import parse_seeds
from jbench.settings.algorithms import default_base
from jbench.settings.base import Seed, Settings, in_id, typed_default, validated, whole
from jbench.settings.records import DatasetSettings
from jbench.settings.run import TYPED, RunSettings
from jbench.simulation.find import dataset_robot, find_task
from jbench.store import Results
from jbench.sweeps.cell import Cell
from jbench.sweeps.matrix_file import COMPARISON, PART, named, read_content, split_into_parts
from jbench.training.request import make_runs, read_representation, requested_ofe

_EVALUATION = "evaluate_"
"""Beginning of the fields of `RunSettings` that are keys of the table [evaluation]."""

# TOML has lists; tuples are immutable.
_Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
_Seeds = Annotated[
    tuple[Seed, ...],
    Field(strict=False, min_length=1),
    BeforeValidator(lambda seeds: parse_seeds(seeds, "seeds") if isinstance(seeds, str) else seeds),
    AfterValidator(lambda seeds: tuple(dict.fromkeys(seeds))),
]


def _keys(kind: type[Settings], *fields: str) -> Any:
    """Returns a base class whose fields are some of other settings, called as users call them."""
    keys: dict[str, Any] = {}
    for name in fields:
        field = kind.model_fields[name]
        # TOML parses 5e6 as a float.
        type_: Any = Annotated[field.annotation, *field.metadata, BeforeValidator(whole)]
        key = (field.title or name).removeprefix(_EVALUATION)
        keys[key] = type_, Field(default=typed_default(field), description=field.description)
    return create_model("Keys", __base__=Settings, **keys)


class EvaluationPart(_keys(RunSettings, *(n for n in TYPED if n.startswith(_EVALUATION)))):  # type: ignore[misc]
    """The table [evaluation]."""


class DatasetPart(_keys(DatasetSettings, "steps", "seed")):  # type: ignore[misc]
    """The table [dataset]: the dataset on which missing encoders are trained."""


class EncoderPart(Settings):
    """The table [encoder]: how missing encoders are trained."""

    seed: Seed | Literal["each"] = Field(
        default=0, description="of all encoders, or each: the seed of the agent"
    )
    options: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="options by kind that differ from the defaults"
    )


class Matrix(_keys(RunSettings, *(n for n in TYPED if not n.startswith(_EVALUATION)))):  # type: ignore[misc]
    """Content of a file, or of a part of it; `docs/sweeps.md` lists the keys."""

    tasks: _Names
    algos: _Names
    representations: _Names = (FULL,)
    seeds: _Seeds = tuple(range(10))
    settings: Base | None = Field(
        default=None,
        description="source of default hyperparameters; default: published, and suite for other "
        "robots",
    )
    hyperparameters: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="hyperparameters by algorithm that replace the defaults"
    )
    evaluation: EvaluationPart = EvaluationPart()
    dataset: DatasetPart = DatasetPart()
    encoder: EncoderPart = EncoderPart()
    ofe: dict[str, Any] = Field(
        default_factory=dict, description="settings of ofeN that replace the defaults"
    )
    _name: str = PrivateAttr("the matrix")  # of the file or part, for errors

    @property
    def run_fields(self) -> dict[str, Any]:
        """Fields of `RunSettings` that are the same in all runs."""
        typed: dict[str, Any] = {}
        for name in TYPED:
            key = RunSettings.model_fields[name].title or name
            table = self.evaluation if name.startswith(_EVALUATION) else self
            typed[name] = getattr(table, key.removeprefix(_EVALUATION))
        typed["evaluate_every"] = typed["evaluate_every"] or evaluation_interval(self.steps)
        return typed

    def dataset_settings(self, task: str) -> DatasetSettings:
        """Returns the settings of the dataset of a task's encoders."""
        robot = dataset_robot(find_task(task))
        return validated(DatasetSettings, "[dataset]", **self.dataset.model_dump(), **robot)


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
    parts = []
    for where, part in split_into_parts(content, name).items():
        with named(where):
            matrix = validated(Matrix, "the matrix", **{**part, **changes})
            for kind, options in matrix.encoder.options.items():
                make_kind(kind, options)
            # They may be of any size, and are checked even if no representation is one.
            requested_ofe(f"{OFE}12", matrix.ofe)
        matrix._name = where
        parts.append(matrix)
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
            _check_tasks_of_encoders(part)
            for task, algo, name in product(part.tasks, part.algos, part.representations):
                if "/" not in name or name.split("/")[0] == in_id(task):
                    cell = _cell(part, results, task, algo, name)
                    different.setdefault(tuple(run.id for run in cell.runs), cell)
    return list(different.values())


def _check_tasks_of_encoders(matrix: Matrix) -> None:
    """Raises a RequestError if an encoder given by its id is of none of the tasks."""
    for name in matrix.representations:
        task, slash, _ = name.partition("/")
        if slash and task not in map(in_id, matrix.tasks):
            raise RequestError(f"the encoder {name} is of {task}, which is not among the tasks.")


def _wanted(name: str, task: str) -> EncoderSettings:
    """Returns the encoder of a representation such as dae12, dae12-observation or planar."""
    encoder = named_encoder(name, task)
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
        fields |= {"encoder": name, "representation": read_representation(results, name)}
    elif name != FULL:
        dataset = matrix.dataset_settings(task)
        encoders = _encoders(matrix, dataset, task, _wanted(name, task))
        first = encoders[matrix.seeds[0]]
        fields["representation"] = first.representation
        if matrix.encoder.seed == "each":
            fields["encoder_draws"] = first.draws
    runs = make_runs(matrix.seeds, {seed: e.id for seed, e in encoders.items()}, **fields)
    different = tuple({encoder.id: encoder for encoder in encoders.values()}.values())
    return Cell(task, algo, name, runs, default_base(task, matrix.settings), different, dataset)


def _encoders(
    matrix: Matrix, dataset: DatasetSettings, task: str, wanted: EncoderSettings
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
