"""Settings of recorded runs: how they are read, which are alike, and what omitted ones mean.

Another program or a newer version may have written them.
"""

import json
from collections.abc import Collection, Mapping
from functools import lru_cache
from itertools import chain
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic import ValidatorFunctionWrapHandler as Handler
from pydantic_core.core_schema import ValidationInfo

from jbench.settings.algorithms import SETTINGS
from jbench.settings.base import canonical_json, settings_hash
from jbench.settings.records import EXTERNAL, ExternalSettings
from jbench.settings.run import RunSettings
from jbench.settings.specs import CODE_CHECKSUMS, MADE_BY_CODE, Specs, episode_steps

SettingPath = tuple[str, ...]
"""Where a setting is, such as ("hyperparameters", "tau")."""

Flat = dict[SettingPath, Any]
"""Settings by path."""

HYPERPARAMETERS = "hyperparameters"
"""The table of a run's settings that has those of its algorithm."""

SEED = ("seed",)
VARIANT = (*SEED, "steps")
COMPARED = (*VARIANT, "evaluate_every", "evaluate_episodes")
COST = ("task", "representation", "encoder", "encoder_draws", *VARIANT, "augment", "robots")
"""Settings in which runs may differ and still

- form one configuration, and can be trained in one process (SEED),
- form one variant, with one learning curve (VARIANT),
- be comparable, since evaluation does not affect training (COMPARED),
- take about the same time per control step (COST).
"""

ENCODER_VARIANT = ("task", "kind", "latents", *SEED)
"""Encoders that differ only in these have the same options."""

_OF_CODE = {*CODE_CHECKSUMS, *MADE_BY_CODE, "accepted"}
"""Settings that may differ if users' code does."""

_IMPLIED: dict[str, Collection[str]] = {
    "task": ("specs",),
    "representation": ("encoder", "encoder_draws", "ofe"),
    "algo": ("hyperparameters", "parallel", "package", "sources"),
    "augment": ("robots",),
    **dict.fromkeys(("sources", "compiled", "accepted"), _OF_CODE),
}
"""Settings that necessarily differ if another one does."""


class Unreadable(BaseModel):
    """Recorded settings that `RunSettings` rejects: of another program, or of a newer version.

    A field that is not recorded, or has a wrong type, has its default.
    """

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    values: dict[str, Any] = Field(description="the settings as the manifest records them")
    task: str | None = None
    algo: str | None = None
    representation: str | None = None
    seed: int | float | None = None
    steps: int | float | None = None
    engine: str | None = None
    evaluate_episodes: int = 0
    hyperparameters: dict[str, Any] = {}
    augment: Any = RunSettings.model_fields["augment"].default
    robots: int = RunSettings.model_fields["robots"].default

    @property
    def episode_steps(self) -> int:
        """Control steps of an episode."""
        return recorded_episode_steps(self.values)

    @field_validator("*", mode="wrap")
    @classmethod
    def _or_default(cls, value: Any, handler: Handler, info: ValidationInfo) -> Any:
        """Returns a valid value, or the default in place of one of another version."""
        try:
            return handler(value)
        except ValidationError:
            return cls.model_fields[str(info.field_name)].default


def recorded_episode_steps(values: Mapping[str, Any]) -> int:
    """Returns the control steps of an episode of recorded settings, of whichever program."""
    specs = values.get("specs")
    if specs is None:
        return episode_steps(None)
    if isinstance(specs, Mapping):
        length = specs.get("episode_steps")
        if isinstance(length, int) and length > 0:
            return length

    return int(Specs.model_fields["episode_steps"].default)


Run = RunSettings | ExternalSettings | Unreadable


@lru_cache(maxsize=10_000)
def parse_run(text: str) -> Run:
    """Returns the settings of a run from the column `settings` of the table `runs`."""
    return read_run(json.loads(text))


def read_run(values: Mapping[str, Any]) -> Run:
    """Returns the settings of a run from its manifest."""
    kind: type[RunSettings] | type[ExternalSettings] = RunSettings
    if values.get("engine") == EXTERNAL:
        kind = ExternalSettings

    try:
        return kind.model_validate(values)
    except ValidationError:
        named = {name: values[name] for name in Unreadable.model_fields if name in values}
        named["values"] = dict(values)
        return Unreadable(**named)


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
    names = set(free)
    flat = flatten(run)
    if "algo" in names and run.algo not in SETTINGS:
        # It follows from the algorithm.
        flat["engine",] = RunSettings.model_fields["engine"].default

    kept = {
        ".".join(path): value
        for path, value in flat.items()
        if not names & {path[0], path[-1], ".".join(path)}
    }
    return canonical_json(kept)


def without_code(run: Run) -> Run:
    """Returns settings without the checksums of users' code and of the robot."""
    if isinstance(run, Unreadable):
        return run
    specs = run.specs
    if specs is not None:
        specs = specs.model_copy(update=dict.fromkeys((*CODE_CHECKSUMS, *MADE_BY_CODE)))
    own = dict.fromkeys({"sources", "accepted"} & type(run).model_fields.keys())
    return run.model_copy(update={**own, "specs": specs})


def comparable(run: Run, *names: str) -> str:
    """Returns a key that is equal for comparable runs, which may differ in the named settings."""
    return alike(run, (*COMPARED, *with_implied(*names)))


def with_implied(*names: str) -> set[str]:
    """Returns the named settings and those that necessarily differ if these do."""
    return {*names, *chain.from_iterable(_IMPLIED.get(name, ()) for name in names)}


def has_known_defaults(run: Run) -> bool:
    """Returns whether the algorithm of a run, and so the defaults it has, are jbench's own."""
    return run.engine != EXTERNAL and run.algo in SETTINGS


def flatten(settings: Run | Mapping[str, Any]) -> Flat:
    """Returns settings by path, with omitted defaults, without an encoder of the seed's own."""
    if isinstance(settings, Mapping):
        return _flat(json.loads(canonical_json(settings)), ())
    values = json.loads(canonical_json(_shared(settings.values)))
    if has_known_defaults(settings) and isinstance(values.get(HYPERPARAMETERS), dict):
        omitted = SETTINGS[str(settings.algo)].omitted()
        values[HYPERPARAMETERS] = omitted | values[HYPERPARAMETERS]
    return _flat(RunSettings.omitted() | values, ())


def _flat(values: Mapping[str, Any], path: SettingPath) -> Flat:
    """Returns the values of nested mappings by their paths."""
    flat: Flat = {}
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= _flat(value, (*path, name))
        else:
            flat[(*path, name)] = value
    return flat
