"""Engine and hyperparameters of an algorithm by its name, whoever wrote it."""

import inspect
from collections.abc import Mapping
from typing import Any

from pydantic import create_model
from pydantic_core import to_jsonable_python

from jbench import plugins
from jbench.agents.batched.rule import Rule
from jbench.agents.find import algorithm_provenance, find_class, find_engine, package_and_version
from jbench.agents.plugin import Agent
from jbench.errors import RequestError
from jbench.names import TASKS, EngineName, SettingsBase
from jbench.settings.algorithms import SETTINGS, default_base, own_algorithm_fields
from jbench.settings.algorithms.base import Changes
from jbench.settings.base import Settings, canonical_json, omissible, settings_with
from jbench.settings.run import RunSettings
from jbench.sources import checksum

# Arguments of classes that jbench gives, or that do not affect what is learned.
_NOT_SETTINGS = {
    "self",
    "policy",
    "env",
    "seed",
    "device",
    "verbose",
    "tensorboard_log",
    "monitor_wrapper",
    "stats_window_size",
    "support_multi_env",
    "supported_action_spaces",
}
_ANY_NUMBER = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
_NOT_RECORDED = object()


def settings_class(algo: str) -> type[Settings]:
    """Returns the class of the settings of an algorithm; errors are those of `find_class`."""
    if algo in SETTINGS:
        return SETTINGS[algo]

    kind = find_class(algo)
    if issubclass(kind, Agent | Rule):
        settings: type[Settings] = kind.Settings
        return settings

    return _settings_from_arguments(kind)


def _settings_from_arguments(kind: Any) -> type[Settings]:
    """Returns settings whose fields are the arguments of a class, as of stable-baselines3's.

    An argument whose default is no JSON value is recorded only if another value is chosen.
    """
    fields: dict[str, Any] = {}
    for name, argument in inspect.signature(kind.__init__).parameters.items():
        is_internal = name.startswith("_") or name.endswith("_class")
        if name in _NOT_SETTINGS or is_internal or argument.kind in _ANY_NUMBER:
            continue
        try:
            canonical_json({name: argument.default})
            fields[name] = Any, argument.default
        except (TypeError, ValueError):
            fields[name] = Any, omissible(_NOT_RECORDED)

    return create_model(kind.__name__, __base__=Settings, **fields)


def description(algo: str) -> str:
    """Returns the first line of an algorithm's docstring; errors are those of `find_class`."""
    if algo in SETTINGS:
        return plugins.first_line(SETTINGS[algo])
    return plugins.first_line(find_class(algo))


def describe_settings(algo: str) -> list[dict[str, Any]]:
    """Returns name, default (JSON or "required") and description of each setting of an algorithm.

    A subclass that changes only a default need not describe the setting again.
    """
    kind = settings_class(algo)
    described = []
    bases = [base for base in kind.__mro__ if issubclass(base, Settings)]
    for name, field in kind.model_fields.items():
        if field.default is _NOT_RECORDED:
            continue

        default: Any = "required"
        if not field.is_required():
            value = field.get_default(call_default_factory=True)
            try:
                default = to_jsonable_python(value)
            except (TypeError, ValueError):
                raise _unrecordable(name, algo, value) from None

        texts = [base.model_fields[name].description for base in bases if name in base.model_fields]
        text = next(filter(None, texts), "")
        described.append({"name": name, "default": default, "description": text})

    return described


def choose_engine(algo: str, wanted: EngineName | None = None) -> EngineName:
    """Returns the engine that trains an algorithm, by default the one that follows from it.

    Raises:
        RequestError: if there is no such algorithm, or it has another engine.
        WorkError: see `find_class`.
    """
    if algo in SETTINGS:
        return SETTINGS[algo].choose_engine(algo, wanted)

    engine = find_engine(algo)
    if wanted not in (None, engine):
        raise RequestError(f"{algo} has the engine {engine}, not {wanted}; leave the engine out.")

    return engine


def algorithm_fields(
    algo: str,
    engine: EngineName | None = None,
    base: SettingsBase | None = None,
    overrides: Mapping[str, Any] | None = None,
    task: str = TASKS[0],
) -> dict[str, Any]:
    """Returns the fields of `RunSettings` that describe an algorithm.

    Args:
        engine: see `choose_engine`.
        base: source of the defaults of jbench's own algorithms; None for that of the task.
        overrides: hyperparameters by name that replace them.

    Raises:
        RequestError: if there is no such algorithm, or a setting is unknown or invalid.
        WorkError: if the package of an agent can't be imported.
    """
    if algo in SETTINGS:
        return own_algorithm_fields(algo, engine, default_base(task, base), overrides)

    chosen_engine = choose_engine(algo, engine)
    of_source = _source_changes(algo, base, task)
    settings = settings_with(settings_class(algo), algo, {**of_source, **(overrides or {})})
    return {
        "algo": algo,
        "engine": chosen_engine,
        "hyperparameters": _recorded(algo, settings),
        "package": package_and_version(algo),
        "sources": checksum(algorithm_provenance(algo).get("sources", {})),
    }


def _recorded(algo: str, settings: Settings) -> dict[str, Any]:
    """Returns settings of a class of others as JSON; a RequestError names one that is none.

    A set of texts is sorted, since its order differs between processes.
    """
    recorded: dict[str, Any] = {}
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        try:
            recorded |= settings.model_dump(mode="json", include={name})
            canonical_json({name: recorded.get(name)})
        except (TypeError, ValueError):
            raise _unrecordable(name, algo, value) from None

        if isinstance(value, set | frozenset) and any(isinstance(each, str) for each in value):
            recorded[name].sort()

    return recorded


def _unrecordable(setting: str, algo: str, value: object) -> RequestError:
    """Returns the error for a setting whose value is no JSON."""
    return RequestError(
        f"The setting {setting} of {algo} is {value!r:.60}, which can't be recorded: use finite "
        "numbers, texts, and lists or mappings of them."
    )


def _source_changes(algo: str, base: SettingsBase | None, task: str) -> Changes:
    """Returns what a source of hyperparameters changes in those of an algorithm of others.

    Only update rules may have sources, as those of `jbench.rules` have; `base` None is then the
    source of the task.
    """
    kind = find_class(algo)
    sources = kind.bases if issubclass(kind, Rule) else {}
    chosen = default_base(task, base) if sources else base
    if chosen in sources:
        changes: Changes = sources[chosen]
        return changes
    if chosen in (None, "published"):
        return {}
    having = f"it has {', '.join(sources)}" if sources else "it has its own defaults"
    raise RequestError(f"There are no settings {base} for {algo}: {having}.")


def hyperparameters(run: RunSettings) -> Settings:
    """Returns the hyperparameters of a run as an object; see `settings_class`."""
    return settings_with(settings_class(run.algo), run.algo, run.hyperparameters)
