"""A matrix of runs: tasks, algorithms, representations and seeds, read from a TOML file.

A file may consist of several parts, each a matrix, and list planned comparisons (`entries.py`).
Nothing heavy is imported here, since every report reads the shipped files.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, create_model

from jbench.errors import RequestError
from jbench.names import SettingsBase
from jbench.representation_names import FULL, OFE
from jbench.settings.base import Seed, Settings, typed_default, validated, whole
from jbench.settings.records import LABEL, DatasetSettings, requested_ofe
from jbench.settings.run import TYPED, RunSettings
from jbench.studies.file import read_file, refusals_named, tables
from jbench.typed_values import known, parse_numbers
from jbench.wording import in_prose

PART = "part"
COMPARISON = "comparison"
"""Keys of a file whose values are arrays of tables; all others are those of a `Matrix`."""

OF_EVALUATION = "evaluate_"
"""Beginning of the fields of `RunSettings` that are keys of the table [evaluation]."""


def _typed_seeds(value: Any) -> Any:
    """Returns the seeds of a text such as 0-4, and a list as it is; a ValueError for a number."""
    if isinstance(value, str):
        return parse_numbers(value, "seeds")
    if isinstance(value, int | float):
        raise ValueError('type "0-4" for five seeds, or a list such as [0, 2]')
    return value


# TOML has lists; tuples are immutable.
_Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
_Seeds = Annotated[
    tuple[Seed, ...],
    Field(strict=False, min_length=1),
    BeforeValidator(_typed_seeds, json_schema_input_type=str | tuple[Seed, ...]),
    AfterValidator(lambda seeds: tuple(dict.fromkeys(seeds))),
]


def _keys(kind: type[Settings], *fields: str) -> Any:
    """Returns a base class whose fields are some of other settings, called as users call them."""
    keys: dict[str, Any] = {}
    for name in fields:
        field = kind.model_fields[name]
        # TOML parses 5e6 as a float.
        type_: Any = Annotated[field.annotation, *field.metadata, BeforeValidator(whole)]
        key = (field.title or name).removeprefix(OF_EVALUATION)
        keys[key] = type_, typed_default(field)
    return create_model("Keys", __base__=Settings, **keys)


_Evaluation = _keys(RunSettings, *(name for name in TYPED if name.startswith(OF_EVALUATION)))
_Dataset = _keys(DatasetSettings, "steps", "seed")


def encoder_seed(value: Any) -> Any:
    """Returns the seed of the encoders of a part, as typed; raises a ValueError if it is none."""
    if value != "each" and (not isinstance(value, int) or value < 0):
        raise ValueError('it should be a whole number, 0 or more, or "each"')
    return value


def _tables(key: str, owner: str, such_as: str) -> Callable[[Any], Any]:
    """Returns a validator of a table of tables, one for each algorithm or kind of encoder."""

    def check(table: Any) -> Any:
        for name, value in table.items() if isinstance(table, dict) else ():
            if not isinstance(value, dict):
                raise RequestError(
                    f"{name} is directly in the table {key}: write it in that of its {owner}, such "
                    f"as {key}.{such_as}.{name}."
                )
        return table

    return check


class EncoderPart(Settings):
    """The table [encoder]: how missing encoders are trained."""

    # Of all encoders, or each: the seed of the agent.
    seed: Annotated[Seed | Literal["each"], BeforeValidator(encoder_seed)] = 0
    options: Annotated[
        dict[str, dict[str, Any]], BeforeValidator(_tables("encoder.options", "kind", "dae"))
    ] = Field(default_factory=dict)


class Matrix(_keys(RunSettings, *(n for n in TYPED if not n.startswith(OF_EVALUATION)))):  # type: ignore[misc]
    """Content of a file, or of a part of it; `docs/sweeps.md` lists the keys."""

    name: Annotated[str, Field(pattern=LABEL)] | None = None  # of a part, for --only
    tasks: _Names
    algos: _Names
    representations: _Names = (FULL,)
    seeds: _Seeds = tuple(range(10))
    settings: SettingsBase | None = None  # None for that of the task
    hyperparameters: Annotated[
        dict[str, dict[str, Any]], BeforeValidator(_tables("hyperparameters", "algorithm", "td3"))
    ] = Field(default_factory=dict)
    evaluation: _Evaluation = _Evaluation()  # type: ignore[valid-type]
    dataset: _Dataset = _Dataset()  # type: ignore[valid-type]  # of missing encoders
    encoder: EncoderPart = EncoderPart()
    ofe: dict[str, Any] = Field(default_factory=dict)  # changed settings of ofeN

    @property
    def run_fields(self) -> dict[str, Any]:
        """Fields of `RunSettings` that are the same in all runs."""
        keys = self.model_dump()
        for key, value in keys["evaluation"].items():
            keys[f"{OF_EVALUATION}{key}"] = value
        return {name: keys[RunSettings.model_fields[name].title or name] for name in TYPED}


Parts = Mapping[str, Matrix]
"""The parts of a file by their names in errors."""


def read_matrix(name: str, **changes: Any) -> dict[str, Matrix]:
    """Returns the parts of a matrix by their names in errors; a file without parts has one.

    The name is one of `SWEEPS` or the path of a .toml file; `changes` replace the file's keys in
    all parts. Raises a RequestError if there is no such matrix, or it is invalid.
    """
    content = read_file(name)
    with refusals_named(name):
        for key in content:
            known("key", key, (*Matrix.model_fields, PART, COMPARISON))

    # Keys outside the parts are defaults for all of them.
    defaults = {key: value for key, value in content.items() if key not in (PART, COMPARISON)}
    parts = {}
    for where, table in (tables(name, content, PART) or {name: {}}).items():
        with refusals_named(where):
            keys = _merged(defaults, table) | changes
            part = validated(Matrix, "the matrix", **keys)
            requested_ofe(f"{OFE}12", part.ofe)  # which checks them, of any size and if unused

        parts[where] = part

    trained = {algo for part in parts.values() for algo in part.algos}
    given = {algo for part in parts.values() for algo in part.hyperparameters}
    for algo in sorted(given - trained):
        raise RequestError(
            f"{name}: [hyperparameters.{algo}] is for {algo}, which is not among the algos; leave "
            "the table out, or add it to them."
        )

    return parts


def _merged(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the keys of a part over the defaults of the file, nested tables merged."""
    merged = {**defaults, **values}
    for key in defaults.keys() & values.keys():
        if isinstance(defaults[key], Mapping) and isinstance(values[key], Mapping):
            merged[key] = _merged(defaults[key], values[key])
    return merged


def only(parts: Parts, chosen: Collection[str]) -> dict[str, Matrix]:
    """Returns what is left of some parts if only certain names are chosen; none for everything.

    A name is that of a part, a task, an algorithm or a representation. Of several tasks, each
    counts; a task and an algorithm have to hold both, and so on. Raises a RequestError if a name is
    unknown, or nothing is left.
    """
    matrices = parts.values()
    names: dict[str, list[str]] = {
        "name": [part.name for part in matrices if part.name is not None],
        "tasks": [task for part in matrices for task in part.tasks],
        "algos": [algo for part in matrices for algo in part.algos],
        "representations": [name for part in matrices for name in part.representations],
    }
    every = list(dict.fromkeys(name for kind in names.values() for name in kind))
    for name in chosen:
        known("part, task, algorithm or representation", name, every)

    wanted = {key: [name for name in chosen if name in kind] for key, kind in names.items()}

    left = {}
    for where, part in parts.items():
        kept = {
            key: tuple(
                name for name in getattr(part, key) if name in wanted[key] or not wanted[key]
            )
            for key in ("tasks", "algos", "representations")
        }
        has_name = part.name in wanted["name"] or not wanted["name"]
        if has_name and all(kept.values()):
            left[where] = part.model_copy(update=kept)

    if not left:
        raise RequestError(f"No part of the matrix has {in_prose(chosen, 'and')}; leave one out.")

    return left
