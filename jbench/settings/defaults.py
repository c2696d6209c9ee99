"""What was chosen for a run: its settings that are not the defaults of its task and algorithm."""

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import chain
from typing import Any

from jbench.names import SettingsBase
from jbench.settings.algorithms import (
    SETTINGS,
    algorithm_settings,
    default_base,
    default_time_limit,
)
from jbench.settings.base import canonical_json, typed_default
from jbench.settings.recorded import (
    HYPERPARAMETERS,
    Flat,
    Run,
    SettingPath,
    flatten,
    has_known_defaults,
)
from jbench.settings.run import TYPED, RunSettings

BASE = "settings"
"""The option of `jbench train` that chooses a source of all hyperparameters."""


@dataclass(frozen=True)
class Chosen:
    """The settings of a run that are not defaults.

    Attributes:
        base: the source of hyperparameters from which the fewest differ; None for algorithms that
            are not jbench's, whose defaults are not known.
        is_usual_base: whether users of the task get this source if they choose none.
        options: fields of the run, by name.
        hyperparameters: those that differ from the source, by name; all of them without a source.
        features: settings of learned features, by name.
    """

    base: SettingsBase | None
    is_usual_base: bool
    options: Mapping[str, Any]
    hyperparameters: Mapping[str, Any]
    features: Mapping[str, Any]


def chosen(run: RunSettings) -> Chosen:
    """Returns the settings of a run that are not defaults."""
    base = nearest_base(run.algo, run.hyperparameters, run.task)
    values = {name: getattr(run, name) for name in TYPED}
    options = {
        name: value for name, value in values.items() if value != _if_not_typed(name, run, base)
    }
    return Chosen(
        base=base,
        is_usual_base=base in (None, default_base(run.task)),
        options=options,
        hyperparameters=_changed(run.algo, run.hyperparameters, base),
        features=_chosen_features(run),
    )


def chosen_paths(run: Run | Mapping[str, Any]) -> set[SettingPath]:
    """Returns the paths of the settings of a run that are known not to be the defaults.

    Unknown are the defaults of other programs, and of hyperparameters of other packages.
    """
    if not isinstance(run, RunSettings):
        return set()

    choices = chosen(run)
    paths: set[SettingPath] = {(name,) for name in choices.options}
    paths |= {("ofe", name) for name in choices.features}
    if choices.base is not None:
        paths |= {(HYPERPARAMETERS, name) for name in choices.hyperparameters}
        if not choices.is_usual_base:
            paths.add((BASE,))

    return paths


def foreign_differences(runs: Iterable[Run]) -> dict[str, set[SettingPath]]:
    """Returns the hyperparameters in which runs of an algorithm differ, by algorithm.

    They are those of algorithms of other packages, whose defaults are unknown: where one of them
    differs between two representations or tasks, the names of both have it.
    """
    recorded: dict[str, list[Flat]] = {}
    for run in runs:
        if has_known_defaults(run):
            continue
        flat = {path: value for path, value in flatten(run).items() if path[0] == HYPERPARAMETERS}
        recorded.setdefault(str(run.algo), []).append(flat)

    return {algo: differing_paths(flats) for algo, flats in recorded.items()}


def differing_paths(flats: Collection[Flat]) -> set[SettingPath]:
    """Returns the paths that do not have one value everywhere."""
    return {
        path
        for path in set(chain.from_iterable(flats))
        if len({json.dumps(values.get(path, ...), default=repr) for values in flats}) > 1
    }


def nearest_base(algo: str, hyperparameters: Mapping[str, Any], task: str) -> SettingsBase | None:
    """Returns the source with the fewest changes, of several the task's; None for foreign ones."""
    if algo not in SETTINGS:
        return None
    usual = default_base(task)
    bases = sorted(SETTINGS[algo].bases, key=lambda base: base != usual)
    return min(bases, key=lambda base: len(_changed(algo, hyperparameters, base)))


def _changed(
    algo: str, hyperparameters: Mapping[str, Any], base: SettingsBase | None
) -> dict[str, Any]:
    """Returns the hyperparameters that differ from those of a source; all of foreign ones."""
    if base is None:
        return dict(hyperparameters)
    recorded = {**_omitted(algo), **hyperparameters}
    usual = _source_values(algo, base)
    return {name: value for name, value in recorded.items() if usual.get(name, ...) != value}


@cache
def _omitted(algo: str) -> Mapping[str, Any]:
    """Returns the hyperparameters that records omit at their default, as JSON values."""
    omitted: dict[str, Any] = json.loads(canonical_json(SETTINGS[algo].omitted()))
    return omitted


@cache
def _source_values(algo: str, base: SettingsBase) -> Mapping[str, Any]:
    """Returns all hyperparameters of a source, as JSON values."""
    return {**_omitted(algo), **algorithm_settings(algo, base).values}


def _if_not_typed(name: str, run: RunSettings, base: SettingsBase | None) -> Any:
    """Returns the value that an option of `jbench train` has if it is left out.

    It is None if it follows from other options.
    """
    if name == "time_limit":
        return default_time_limit(base)
    if name == "engine" and run.algo in SETTINGS:
        return SETTINGS[run.algo].choose_engine(run.algo)
    if name == "engine":
        return run.engine
    return typed_default(RunSettings.model_fields[name])


def _chosen_features(run: RunSettings) -> dict[str, Any]:
    """Returns the settings of learned features, but their number, that are not defaults."""
    if run.ofe is None:
        return {}
    fields = type(run.ofe).model_fields
    return {
        name: value
        for name, value in run.ofe.values.items()
        if name != "units" and value != fields[name].default
    }
