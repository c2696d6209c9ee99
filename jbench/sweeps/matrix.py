"""A matrix of runs: tasks, algorithms, representations and seeds, read from a TOML file.

A file may consist of several parts, each a matrix, and list the comparisons of `--until-decided`.
"""

import contextlib
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, create_model

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
        keys[key] = type_, typed_default(field)
    return create_model("Keys", __base__=Settings, **keys)


_Evaluation = _keys(RunSettings, *(name for name in TYPED if name.startswith(_EVALUATION)))
_Dataset = _keys(DatasetSettings, "steps", "seed")


def _seed(value: Any) -> Any:
    if value != "each" and (not isinstance(value, int) or value < 0):
        raise ValueError('it should be a whole number, 0 or more, or "each"')
    return value


class EncoderPart(Settings):
    """The table [encoder]: how missing encoders are trained."""

    # Of all encoders, or each: the seed of the agent.
    seed: Annotated[Seed | Literal["each"], BeforeValidator(_seed)] = 0
    options: dict[str, dict[str, Any]] = Field(default_factory=dict)  # by kind


class Matrix(_keys(RunSettings, *(n for n in TYPED if not n.startswith(_EVALUATION)))):  # type: ignore[misc]
    """Content of a file, or of a part of it; `docs/sweeps.md` lists the keys."""

    tasks: _Names
    algos: _Names
    representations: _Names = (FULL,)
    seeds: _Seeds = tuple(range(10))
    settings: Base | None = None  # None for that of the task
    hyperparameters: dict[str, dict[str, Any]] = Field(default_factory=dict)  # by algorithm
    evaluation: _Evaluation = _Evaluation()  # type: ignore[valid-type]
    dataset: _Dataset = _Dataset()  # type: ignore[valid-type]  # of missing encoders
    encoder: EncoderPart = EncoderPart()
    ofe: dict[str, Any] = Field(default_factory=dict)  # changed settings of ofeN

    @property
    def run_fields(self) -> dict[str, Any]:
        """Fields of `RunSettings` that are the same in all runs."""
        keys = self.model_dump()
        keys |= {f"{_EVALUATION}{key}": value for key, value in keys["evaluation"].items()}
        typed = {name: keys[RunSettings.model_fields[name].title or name] for name in TYPED}
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
    share: Annotated[float, Field(gt=0)] = 0.0  # of the error rate; 0 until the rest is divided
    max_seeds: Annotated[_Count, Field(multiple_of=BLOCK)] = 0  # 0 for --max-seeds
    steps: _Count | None = None


def read_matrix(name: str, **changes: Any) -> dict[str, Matrix]:
    """Returns the parts of a matrix by their names in errors; a file without parts has one.

    The name is one of `SWEEPS` or the path of a .toml file; `changes` replace the file's keys in
    all parts. Raises a RequestError if there is no such matrix, or it is invalid.
    """
    content = _content(name)
    # Keys outside the parts are defaults for all of them.
    defaults = {key: value for key, value in content.items() if key not in (PART, COMPARISON)}
    parts = {}
    for where, table in (_tables(name, content, PART) or {name: {}}).items():
        with named(where):
            part = validated(Matrix, "the matrix", **{**_merged(defaults, table), **changes})
            for kind, options in part.encoder.options.items():
                make_kind(kind, options)
            requested_ofe(f"{OFE}12", part.ofe)  # which checks them, of any size and if unused
        parts[where] = part
    trained = {algo for part in parts.values() for algo in part.algos}
    given = {algo for part in parts.values() for algo in part.hyperparameters}
    for algo in sorted(given - trained):
        raise RequestError(
            f"{name}: [hyperparameters.{algo}] is for {algo}, which is not among the algos; leave "
            "the table out, or add it to them."
        )
    engines = sorted({part.engine or "batched" for part in parts.values()})
    if len(engines) > 1:
        raise RequestError(f"{name}: all parts need the same engine, not {' and '.join(engines)}.")
    return parts


def read_comparisons(name: str) -> list[Planned]:
    """Returns the comparisons that a matrix file lists; none if it leaves the choice to jbench.

    Those without a share of the error rate get equal shares of the rest. Raises a RequestError if
    an entry is invalid, or the shares add up to more than the error rate.
    """
    planned = []
    for where, table in _tables(name, _content(name), COMPARISON).items():
        with named(where):
            planned.append(validated(Planned, f"[[{COMPARISON}]]", **table))
    given, rest = sum(entry.share for entry in planned), sum(not entry.share for entry in planned)
    if given > ERROR_RATE + 1e-9 or (rest and given > ERROR_RATE - 1e-9):
        left = f", and {rest} without a share need a rest" if rest else ""
        raise RequestError(
            f"{name}: the shares of the comparisons add up to {given:g}{left}; together they have "
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


def _tables(name: str, content: Mapping[str, Any], key: str) -> dict[str, dict[str, Any]]:
    """Returns the tables of an array of tables by names for errors; none without this key."""
    tables = content.get(key, [])
    is_array = isinstance(tables, list) and all(isinstance(table, dict) for table in tables)
    if not is_array or (key in content and not tables):
        raise RequestError(f"{name}: {key} is an array of tables: write [[{key}]] above each.")
    return {f"{name}, {key} {n}": table for n, table in enumerate(tables, 1)}


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
        content = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise RequestError(f"{name} can't be read ({reason}).") from None
    except (ValueError, RecursionError) as error:  # ValueError: also of thousands of digits
        raise RequestError(f"{name} is not TOML ({error}); docs/sweeps.md shows a file.") from None
    with named(name):
        for key in content:
            known("key", key, (*Matrix.model_fields, PART, COMPARISON))
    return content
