"""The matrix file that trains recorded runs again."""

import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jbench.settings.base import canonical_json, in_id, task_and_representation
from jbench.settings.recorded import SEED, Run, alike, read_run
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.settings.run import TYPED, RunSettings
from jbench.studies.file import NULL
from jbench.studies.matrix import OF_EVALUATION
from jbench.typed_values import in_ranges
from jbench.wording import counted, were

_OWN = ("tasks", "algos", "representations", "seeds", "encoder", "ofe")
"""Keys of a part that are never written once for all parts."""

_BARE = re.compile(r"[A-Za-z0-9_-]+")

Recorded = Mapping[str, Mapping[str, Any]]
"""Recorded settings by id."""


@dataclass(frozen=True)
class SameSettings:
    """Runs that differ only in their seeds.

    Attributes:
        run: the settings of one of them.
        seeds: those of all, in order.
    """

    run: RunSettings
    seeds: tuple[int, ...]


def groups(runs: Iterable[Run]) -> list[SameSettings]:
    """Returns the runs that jbench can train, by their settings without seeds."""
    found: dict[str, list[RunSettings]] = {}
    for run in runs:
        if _is_trained_here(run):
            assert isinstance(run, RunSettings)
            found.setdefault(alike(run, SEED), []).append(run)
    return [
        SameSettings(same[0], tuple(sorted({run.seed for run in same}))) for same in found.values()
    ]


def _is_trained_here(run: Run) -> bool:
    """Returns whether jbench trains a run, with the same code from its beginning to its end."""
    return isinstance(run, RunSettings) and run.accepted is None


def matrix_text(runs: Iterable[Mapping[str, Any]], encoders: Recorded, datasets: Recorded) -> str:
    """Returns a matrix file for `jbench sweep` that trains recorded runs.

    Values that all parts share are written once, above the parts. Runs that jbench can't train,
    such as those of recorded loops, are named in comments, as are datasets that it can't make.

    Args:
        runs: settings of the runs.
        encoders: those of their encoders.
        datasets: those of the datasets of these encoders.
    """
    recorded = [read_run(settings) for settings in runs]
    others: dict[str, int] = {}
    for run in recorded:
        if not _is_trained_here(run):
            name = " ".join(f"{run.task} {run.algo} {run.representation}".split())
            others[name] = others.get(name, 0) + 1
    trained = groups(recorded)
    parts = _joined([_part(group, encoders, datasets) for group in trained])
    shared = _shared(parts)

    lines = ["# What trains these runs: jbench sweep matrix.toml"]
    for name, count in others.items():
        lines.append(
            f"# {counted(count, 'run')} of {name} {were(count)} trained by another program, or by "
            "changed code."
        )
    unknown = (_unknown_of_encoder(group.run, encoders, datasets) for group in trained)
    lines += filter(None, dict.fromkeys(unknown))
    if shared:
        lines += ["", *_lines(shared)]
    for part in parts:
        lines += ["", "[[part]]"]
        lines += _lines(part)
    return "\n".join(lines) + "\n"


def _part(group: SameSettings, encoders: Recorded, datasets: Recorded) -> dict[str, Any]:
    """Returns the keys of the part of a matrix that trains runs of the same settings."""
    run = group.run
    part: dict[str, Any] = {
        "tasks": [run.task],
        "algos": [run.algo],
        "representations": [run.representation],
        "seeds": in_ranges(group.seeds),
    }
    fields = RunSettings.model_fields
    for name in TYPED:
        value = getattr(run, name)
        if not name.startswith(OF_EVALUATION) and value != fields[name].default:
            part[fields[name].title or name] = value

    part["steps"] = run.steps
    part["time_limit"] = run.time_limit
    part["evaluation"] = {"every": run.evaluate_every, "episodes": run.evaluate_episodes}
    part["hyperparameters"] = {run.algo: dict(sorted(run.hyperparameters.items()))}
    if run.ofe is not None:
        values = run.ofe.values
        part["ofe"] = {name: value for name, value in values.items() if name != "units"}

    if run.encoder is None:
        return part
    if run.encoder_draws is None:
        # By its name, it would be trained again, perhaps on another dataset.
        part["representations"] = [run.encoder]
        return part

    part["encoder"] = {"seed": "each"}
    if run.encoder in encoders:
        settings = encoders[run.encoder]
        part["encoder"]["options"] = {settings["kind"]: settings["options"]}
        keys = _dataset_keys(run, settings, datasets)
        if keys:
            part["dataset"] = keys

    return part


def _dataset_keys(
    run: RunSettings, encoder: Mapping[str, Any], datasets: Recorded
) -> dict[str, Any] | None:
    """Returns the table [dataset] from which a run's encoder is trained; None if it is not known.

    It is empty for the dataset of a matrix without this table.
    """
    # The one that a matrix makes for a run if it does not say which.
    usual = DatasetSettings.model_validate(dataset_robot(run.task, run.specs))
    id = str(encoder.get("dataset"))
    if id == usual.id:
        return {}
    recorded = datasets.get(id)
    if recorded is None or recorded.get("augment") is not None:
        return None
    return {"steps": recorded.get("steps"), "seed": recorded.get("seed")}


def _unknown_of_encoder(run: RunSettings, encoders: Recorded, datasets: Recorded) -> str:
    """Returns a comment on what a matrix lacks of the encoders that seeds have each; "" if nothing.

    See `matrix_text` for the arguments.
    """
    if run.encoder_draws is None:
        return ""
    if run.encoder is None or run.encoder not in encoders:
        return f"# The options of {run.encoder} are not known: add them."

    encoder = encoders[run.encoder]
    if _dataset_keys(run, encoder, datasets) is not None:
        return ""

    dataset = " ".join(str(encoder.get("dataset")).split())
    return f"# Encoders learned from {dataset}, whose steps are not known: add them."


def _joined(parts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns parts that differ only in task or representation as one."""
    alike_parts: dict[str, list[dict[str, Any]]] = {}
    for part in parts:
        rest = {name: part[name] for name in part if name not in ("tasks", "representations")}
        alike_parts.setdefault(canonical_json(rest), []).append(part)

    joined = []
    for same in alike_parts.values():
        whole = _together(same)
        if _combinations(whole) == {pair for part in same for pair in _combinations(part)}:
            joined.append(whole)
            continue

        by_task: dict[str, list[dict[str, Any]]] = {}
        for part in same:
            by_task.setdefault(part["tasks"][0], []).append(part)
        joined += map(_together, by_task.values())

    return joined


def _together(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Returns one part with the tasks and the representations of several."""
    together = dict(parts[0])
    for key in ("tasks", "representations"):
        together[key] = list(dict.fromkeys(name for part in parts for name in part[key]))
    return together


def _combinations(part: Mapping[str, Any]) -> set[tuple[str, str]]:
    """Returns the tasks and representations of a part; an encoder's id is for its own task."""
    return {
        (task, name)
        for task in part["tasks"]
        for name in part["representations"]
        if "/" not in name or task_and_representation(name)[0] == in_id(task)
    }


def _shared(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Takes what all parts share out of them, and returns it; also of each algorithm's parts."""
    if len(parts) < 2:
        return {}
    shared = _taken(parts, leaving=(*_OWN, "hyperparameters"))

    of_algorithms: dict[str, list[dict[str, Any]]] = {}
    for part in parts:
        ((algo, values),) = part["hyperparameters"].items()
        of_algorithms.setdefault(algo, []).append(values)
    for algo, tables in of_algorithms.items():
        same = _taken(tables)
        if same:
            shared[f"hyperparameters.{algo}"] = same

    for part in parts:
        if not any(part["hyperparameters"].values()):
            del part["hyperparameters"]
    return shared


def _taken(tables: Sequence[dict[str, Any]], leaving: Collection[str] = ()) -> dict[str, Any]:
    """Takes what all tables share out of them, but some keys, and returns it."""
    same = {
        name: value
        for name, value in tables[0].items()
        if name not in leaving and all(name in table and table[name] == value for table in tables)
    }
    for table in tables:
        for name in same:
            del table[name]
    return same


def _lines(part: Mapping[str, Any]) -> list[str]:
    """Returns keys and values as lines of TOML."""
    return [f"{_key(name)} = {_toml(value)}" for name, value in part.items()]


def _key(name: str) -> str:
    """Returns a key of TOML, quoted where it has other characters, dotted for a table's key."""
    table, dot, key = name.partition(".")
    return f"{table}{dot}{_quoted(key)}" if dot else _quoted(name)


def _quoted(name: str) -> str:
    """Returns a key, in quotes if it has other characters than a bare one."""
    return name if _BARE.fullmatch(name) else _text(name)


def _toml(value: Any) -> str:
    """Returns a JSON value as TOML; null, which TOML does not have, as `NULL`."""
    if value is None:
        return _text(NULL)
    if isinstance(value, Mapping):
        pairs = [f"{_quoted(str(name))} = {_toml(item)}" for name, item in value.items()]
        return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return repr(value)  # inf and nan as well, which JSON does not have
    return _text(value) if isinstance(value, str) else json.dumps(value)


def _text(value: str) -> str:
    """Returns a string of TOML, whose escapes are those of JSON."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
