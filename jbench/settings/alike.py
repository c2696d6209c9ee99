"""Which settings are alike, and what an omitted setting means: the one place that says so."""

import json
from collections.abc import Collection, Mapping
from typing import Any

from jbench.settings.algorithms import SETTINGS
from jbench.settings.base import canonical_json, settings_hash
from jbench.settings.external import EXTERNAL
from jbench.settings.run import Run, RunSettings

Flat = dict[tuple[str, ...], Any]
"""Settings by their paths, as ("hyperparameters", "tau")."""

SEED = ("seed",)
"""Runs that differ in these alone can be trained in one process."""

VARIANT = ("seed", "steps")
"""Runs that differ in these alone are a variant: they make one curve."""

COMPARED = (*VARIANT, "evaluate_every", "evaluate_episodes")
"""Runs that differ in these can be compared: evaluating changes nothing of the training."""

COST = ("task", "representation", "encoder", "seed", "steps", "augment", "robots")
"""Runs that differ in these alone take equally long for a control step, or nearly."""

ENCODER_VARIANT = ("task", "kind", "latents", "seed")
"""Encoders that differ in these alone have the same options."""

_IMPLIED = {
    "representation": ("encoder", "ofe"),
    "algo": ("hyperparameters", "parallel"),
    "augment": ("robots",),
}
"""Settings that can't stay the same where another one differs."""


def variant(values: Mapping[str, Any]) -> str:
    """Returns the hash of a run's recorded settings but seed and steps."""
    return settings_hash({name: v for name, v in values.items() if name not in VARIANT})


def alike(run: Run, free: Collection[str]) -> str:
    """Returns a text that is the same for runs that differ in the free settings alone.

    Args:
        run: with or without its omitted settings.
        free: names; a setting of an algorithm may be named by the last part of its path.
    """
    names = set(free)
    kept = {
        ".".join(path): value
        for path, value in flatten(run).items()
        if not names & {path[0], path[-1], ".".join(path)}
    }
    return canonical_json(kept)


def comparable(run: Run, *names: str) -> str:
    """Returns a text that is the same for runs to compare, which may differ in named settings."""
    return alike(run, (*COMPARED, *with_implied(*names)))


def with_implied(*names: str) -> set[str]:
    """Returns names of settings, and of those that can't stay the same where these differ."""
    return {*names, *(implied for name in names for implied in _IMPLIED.get(name, ()))}


def flatten(settings: Run | Mapping[str, Any]) -> Flat:
    """Returns settings by their paths; those that a run omits at their defaults are there, too.

    Args:
        settings: of a run, or recorded settings of something else.
    """
    if isinstance(settings, Mapping):
        return _flat(_sorted(settings), ())
    values = _sorted(settings.values)
    ours = settings.engine != EXTERNAL and settings.algo in SETTINGS
    if ours and isinstance(values.get("hyperparameters"), dict):
        values["hyperparameters"] = (
            SETTINGS[str(settings.algo)].omitted() | values["hyperparameters"]
        )
    return _flat(RunSettings.omitted() | values, ())


def _sorted(values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a copy whose names are sorted, at all depths."""
    copy: dict[str, Any] = json.loads(canonical_json(values))
    return copy


def _flat(values: Mapping[str, Any], path: tuple[str, ...]) -> Flat:
    flat: Flat = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, (*path, name))
        else:
            flat[(*path, name)] = value
    return flat
