"""Equivalences of settings, and the meaning of omitted settings, defined in one place."""

import json
from collections.abc import Collection, Mapping
from typing import Any

from jbench.settings.algorithms import SETTINGS
from jbench.settings.base import canonical_json, settings_hash
from jbench.settings.recorded import Run
from jbench.settings.records import EXTERNAL
from jbench.settings.run import RunSettings

Flat = dict[tuple[str, ...], Any]
"""Settings by path, such as ("hyperparameters", "tau")."""

SEED = ("seed",)
"""Runs that differ only in this form one configuration, and can be trained in one process."""

VARIANT = ("seed", "steps")
"""Runs that differ only in these form one variant, and one learning curve."""

COMPARED = (*VARIANT, "evaluate_every", "evaluate_episodes")
"""Runs that differ in these are comparable: evaluation does not affect training."""

COST = ("task", "representation", "encoder", "encoder_draws", *SEED, "steps", "augment", "robots")
"""Runs that differ only in these take about the same time per control step."""

ENCODER_VARIANT = ("task", "kind", "latents", "seed")
"""Encoders that differ only in these have the same options."""

_IMPLIED = {
    "task": ("specs",),
    "representation": ("encoder", "encoder_draws", "ofe"),
    "algo": ("hyperparameters", "parallel", "package"),
    "augment": ("robots",),
}
"""Settings that necessarily differ if another one does."""


def variant(values: Mapping[str, Any]) -> str:
    """Returns the hash of a run's recorded settings without seed and steps."""
    return settings_hash({n: v for n, v in _shared(values).items() if n not in VARIANT})


def _shared(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns settings without the encoder if it follows from the seed."""
    if values.get("encoder_draws") is None:
        return values
    return {name: value for name, value in values.items() if name != "encoder"}


def alike(run: Run, free: Collection[str]) -> str:
    """Returns a key that is equal for runs that differ only in the free settings.

    A hyperparameter may be named by the last part of its path.
    """
    names, flat = set(free), flatten(run)
    if "algo" in names and run.algo not in SETTINGS:
        # It follows from the algorithm.
        flat["engine",] = RunSettings.model_fields["engine"].default
    kept = {
        ".".join(path): value
        for path, value in flat.items()
        if not names & {path[0], path[-1], ".".join(path)}
    }
    return canonical_json(kept)


def comparable(run: Run, *names: str) -> str:
    """Returns a key that is equal for comparable runs, which may differ in the named settings."""
    return alike(run, (*COMPARED, *with_implied(*names)))


def with_implied(*names: str) -> set[str]:
    """Returns the named settings and those that necessarily differ if these do."""
    return {*names, *(implied for name in names for implied in _IMPLIED.get(name, ()))}


def flatten(settings: Run | Mapping[str, Any]) -> Flat:
    """Returns settings by path, with omitted defaults, without an encoder of the seed's own."""
    if isinstance(settings, Mapping):
        return _flat(json.loads(canonical_json(settings)), ())
    values = json.loads(canonical_json(_shared(settings.values)))
    ours = settings.engine != EXTERNAL and settings.algo in SETTINGS
    if ours and isinstance(values.get("hyperparameters"), dict):
        omitted = SETTINGS[str(settings.algo)].omitted()
        values["hyperparameters"] = omitted | values["hyperparameters"]
    return _flat(RunSettings.omitted() | values, ())


def _flat(values: Mapping[str, Any], path: tuple[str, ...]) -> Flat:
    flat: Flat = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, (*path, name))
        else:
            flat[(*path, name)] = value
    return flat
