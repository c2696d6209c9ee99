"""A matrix of runs: tasks, algorithms, representations and seeds, read from a TOML file.

A file may consist of several parts, each a matrix, and list the comparisons of `--until-decided`.
"""

import contextlib
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, create_model

from jbench.encoders.registry import make_kind
from jbench.errors import RequestError
from jbench.names import FULL, OFE, SWEEPS, Base, evaluation_interval, known, parse_numbers
from jbench.settings.base import Count, Seed, Settings, typed_default, validated, whole
from jbench.settings.records import DatasetSettings
from jbench.settings.run import TYPED, RunSettings
from jbench.statistics.sequential import BLOCK, ERROR_RATE
from jbench.training.request import requested_ofe

PART, COMPARISON = "part", "comparison"
"""Keys of a file whose values are arrays of tables; all others are those of a `Matrix`."""

_EVALUATION = "evaluate_"
"""Beginning of the fields of `RunSettings` that are keys of the table [evaluation]."""

# TOML has lists; tuples are immutable.
_Names = Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
_Seeds = Annotated[
    tuple[Seed, ...],
    Field(strict=False, min_length=1),
    BeforeValidator(lambda text: parse_numbers(text, "seeds") if isinstance(text, str) else text),
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
        description="source of default hyperparameters; default: published, of other robots suite",
    )
    hyperparameters: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="hyperparameters by algorithm that replace the defaults"
    )
    evaluation: EvaluationPart = EvaluationPart()
    dataset: DatasetPart = DatasetPart()
    encoder: EncoderPart = EncoderPart()
    ofe: dict[str, Any] = Field(default_factory=dict, description="changed settings of ofeN")
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


Claim = Literal["a", "c"]
"""What is compared: the final return (a), or the mean return over the run (c)."""

_Count = Annotated[Count, BeforeValidator(whole)]


class Planned(Settings):
    """An entry of the key `comparison` of a matrix file; `docs/deciding.md` explains the keys."""

    task: str
    algo: str
    first: str
    second: str
    claim: Claim = "a"
    share: Annotated[float, Field(gt=0)] | None = None
    max_seeds: Annotated[_Count, Field(multiple_of=BLOCK)] | None = None
    steps: _Count | None = None


def read_matrix(name: str, **changes: Any) -> list[Matrix]:
    """Returns the parts of a matrix; a file without parts has one.

    The name is one of `SWEEPS` or the path of a .toml file; `changes` replace the file's keys in
    all parts. Raises a RequestError if there is no such matrix, or it is invalid.
    """
    content = _content(name)
    with named(name):
        for key in content:
            known("key", key, (*Matrix.model_fields, PART, COMPARISON))
        tables = _tables(content, PART)
    # Keys outside the parts are defaults for all of them.
    defaults = {key: value for key, value in content.items() if key not in (PART, COMPARISON)}
    parts = []
    for n, table in enumerate(tables or [{}], 1):
        where = f"{name}, part {n}" if tables else name
        with named(where):
            matrix = validated(Matrix, "the matrix", **{**_merged(defaults, table), **changes})
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


def read_comparisons(name: str) -> list[Planned]:
    """Returns the comparisons that a matrix file lists; none if it leaves the choice to jbench.

    Those without a share of the error rate get equal shares of the rest. Raises a RequestError if
    an entry is invalid, or the shares add up to more than the error rate.
    """
    planned = []
    with named(name):
        for n, table in enumerate(_tables(_content(name), COMPARISON), 1):
            with named(f"{COMPARISON} {n}"):
                planned.append(validated(Planned, f"[[{COMPARISON}]]", **table))
        given = sum(entry.share or 0 for entry in planned)
        rest = sum(entry.share is None for entry in planned)
        if given > ERROR_RATE + 1e-9 or (rest and given > ERROR_RATE - 1e-9):
            left = f", and {rest} without a share need a rest" if rest else ""
            raise RequestError(
                f"the shares of the comparisons add up to {given:g}{left}; together they have "
                f"{ERROR_RATE:g}, so write smaller ones."
            )
    equal = (ERROR_RATE - given) / max(1, rest)
    return [entry.model_copy(update={"share": entry.share or equal}) for entry in planned]


@contextlib.contextmanager
def named(name: str) -> Iterator[None]:
    """Puts the name of a file or a part in front of the refusals of the block."""
    try:
        yield
    except RequestError as error:
        raise RequestError(f"{name}: {error}") from None


def _tables(content: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """Returns the tables of an array of tables; none if the file does not have this key."""
    tables: list[dict[str, Any]] = content.get(key, [])
    is_array = isinstance(tables, list) and all(isinstance(table, dict) for table in tables)
    if not is_array or (key in content and not tables):
        raise RequestError(f"{key} is an array of tables: write [[{key}]] above each.")
    return tables


def _merged(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    merged = {**defaults, **values}
    for key in defaults.keys() & values.keys():
        if isinstance(defaults[key], Mapping) and isinstance(values[key], Mapping):
            merged[key] = _merged(defaults[key], values[key])
    return merged


def _content(name: str) -> dict[str, Any]:
    path: Any = Path(name)
    if name in SWEEPS:
        path = resources.files("jbench.paper") / "matrices" / f"{name}.toml"
    elif not name.endswith(".toml"):
        file = f"{name}.toml" if Path(f"{name}.toml").exists() else "a FILE.toml"
        known("matrix", name, (*SWEEPS, file))
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise RequestError(f"{name} can't be read ({reason}).") from None
    except (ValueError, RecursionError) as error:  # ValueError: also of thousands of digits
        raise RequestError(f"{name} is not TOML ({error}); docs/sweeps.md shows a file.") from None
