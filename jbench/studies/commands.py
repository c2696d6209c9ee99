"""The commands that trained recorded runs, and those that train them again."""

import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from jbench.names import FULL, Base, in_ranges
from jbench.settings.algorithms import (
    SETTINGS,
    algorithm_settings,
    default_base,
    default_time_limit,
)
from jbench.settings.base import canonical_json, typed_default
from jbench.settings.recorded import Run, read_run
from jbench.settings.run import TYPED, RunSettings
from jbench.store.provenance import shell_command
from jbench.studies.rebuilt_matrix import SameSettings, groups


def commands(
    runs: Iterable[tuple[Mapping[str, Any], object]],
) -> tuple[list[str], list[str]]:
    """Returns the command lines that trained runs, and rebuilt ones where none was recorded.

    Args:
        runs: recorded settings, and the recorded words of the command, None for none.
    """
    typed: dict[str, None] = {}
    rest: list[Run] = []
    for settings, words in runs:
        if isinstance(words, list) and words:
            typed[shell_command({"command": words})] = None
        else:
            rest.append(read_run(settings))
    return list(typed), [train_command(group) for group in groups(rest)]


def train_command(group: SameSettings) -> str:
    """Returns the command that trains runs, where the results contain their encoder."""
    run = group.run
    words = ["jbench", "train", "--task", run.task, "--algo", run.algo]
    if run.encoder_draws is not None:
        words += ["--encoder", run.representation, "--encoder-seeds", "each"]
    elif run.encoder is not None:
        words += ["--encoder", run.encoder]
    elif run.representation != FULL:
        words += ["--encoder", run.representation]
    words += ["--seeds", in_ranges(group.seeds)]

    base = _nearest_base(run)
    if base is not None and base != default_base(run.task):
        words += ["--settings", base]
    for name in TYPED:
        field = RunSettings.model_fields[name]
        value = getattr(run, name)
        if value != _if_not_typed(name, run, base):
            words += [f"--{(field.title or name).replace('_', '-')}", str(value)]
    for name, value in _changed(run, base).items():
        words += ["--set", f"{name}={_set_value(value)}"]
    if run.ofe is not None:
        defaults = type(run.ofe).model_fields
        for name, value in run.ofe.values.items():
            if name != "units" and value != defaults[name].default:
                words += ["--set", f"ofe.{name}={_set_value(value)}"]
    return shlex.join(words)


def _if_not_typed(name: str, run: RunSettings, base: Base | None) -> Any:
    """Returns the value of an option of `jbench train` that is left out, None if it varies."""
    if name == "time_limit":
        return default_time_limit(base)
    if name == "engine":
        return "batched" if run.algo in SETTINGS else run.engine
    return typed_default(RunSettings.model_fields[name])


def _nearest_base(run: RunSettings) -> Base | None:
    """Returns the source of hyperparameters with the fewest changes; None for foreign ones."""
    if run.algo not in SETTINGS:
        return None
    usual = default_base(run.task)
    bases = sorted(SETTINGS[run.algo].bases, key=lambda base: base != usual)
    return min(bases, key=lambda base: len(_changed(run, base)))


def _changed(run: RunSettings, base: Base | None) -> dict[str, Any]:
    """Returns the hyperparameters that differ from those of a source; all of foreign ones."""
    if base is None:
        return dict(run.hyperparameters)
    omitted = json.loads(canonical_json(SETTINGS[run.algo].omitted()))
    recorded = {**omitted, **run.hyperparameters}
    usual = {**omitted, **algorithm_settings(run.algo, base).values}
    return {name: value for name, value in recorded.items() if usual.get(name, ...) != value}


def _set_value(value: Any) -> str:
    """Returns a value as `--set` reads it."""
    if isinstance(value, list) and len(value) > 1:
        return ",".join(map(json.dumps, value))
    if not isinstance(value, str):
        return json.dumps(value)
    try:
        json.loads(value)
    except ValueError:
        return value
    return json.dumps(value)
