"""Algorithms by name: jbench's, those of other packages, and stable-baselines3-like classes."""

import inspect
import re
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from typing import Any

from pydantic import create_model
from pydantic_core import to_jsonable_python

from jbench import plugins
from jbench.agents.batched.rule import Rule
from jbench.agents.plugin import Agent, AgentSettings
from jbench.errors import RequestError, WorkError
from jbench.names import TASKS, Base, Engine, known
from jbench.settings.algorithms import SETTINGS, OffPolicySettings, algorithm_settings, default_base
from jbench.settings.base import Settings, canonical_json, omissible, settings_with
from jbench.settings.run import RunSettings

GROUPS: dict[str, Engine] = {"jbench.agents": "plugin", "jbench.rules": "batched"}
"""Groups of entry points, agents and update rules, and the engine that trains each."""

_INTERFACES: dict[str, tuple[str, Any, Any, str]] = {
    "plugin": ("agent", Agent, AgentSettings, " with explore, act and learn"),
    "batched": ("rule", Rule, OffPolicySettings, ""),
}

_NAME = re.compile(r"[a-z][a-z0-9-]*")

# Arguments of classes that jbench gives, or that do not affect what is learned.
_NOT_SETTINGS = {
    *("self", "policy", "env", "seed", "device", "verbose", "tensorboard_log", "monitor_wrapper"),
    *("stats_window_size", "support_multi_env", "supported_action_spaces"),
}
_ANY_NUMBER = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
_NOT_RECORDED = object()

_ELSEWHERE = {
    "a2c": "use --algo stable_baselines3:A2C",
    "tqc": "use --algo sb3_contrib:TQC",
    "trpo": "use --algo sb3_contrib:TRPO",
    "dqn": "it needs discrete actions, but those of all tasks are continuous",
}
"""Algorithms of other packages whose names are like those of jbench's, and what to do instead."""


def installed() -> dict[str, EntryPoint]:
    """Returns the entry points of the installed agents and update rules by name."""
    return {point.name: point for point in sorted(_offered(), key=lambda point: point.name)}


def find_class(name: str) -> Any:
    """Returns the class of an algorithm that is not jbench's: an `Agent`, a `Rule` or of sb3.

    Raises:
        RequestError: if there is none of this name.
        WorkError: if its package can't be imported, or its class is no agent or rule.
    """
    engine, is_imported = choose_engine(name), plugins.is_imported(name)
    if engine == "sb3":
        from stable_baselines3.common.base_class import BaseAlgorithm  # takes a second to import

        kind = plugins.imported("algorithm", name)
        if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
            raise RequestError(
                f"{name} is no subclass of jbench.Agent, jbench.Rule or stable-baselines3's "
                "BaseAlgorithm; record its training loop with jbench.record (docs/recording.md)."
            )
        return kind
    what, base, settings, methods = _INTERFACES[engine]
    kind = plugins.imported(what, name) if is_imported else plugins.load(what, _entry_point(name))
    is_subclass = isinstance(kind, type) and issubclass(kind, base) and kind is not base
    if not is_subclass or inspect.isabstract(kind):
        raise WorkError(
            f"The {what} {name} is no subclass of jbench.{base.__name__}{methods}; fix it, or "
            "uninstall the package that offers it."
        )
    if not (isinstance(kind.Settings, type) and issubclass(kind.Settings, settings)):
        needed = settings.__name__
        raise WorkError(f"Settings of the {what} {name} is no subclass of jbench.{needed}.")
    return kind


def settings_class(algo: str) -> type[Settings]:
    """Returns the class of the settings of an algorithm; errors are those of `find_class`.

    Those of a class of stable-baselines3's interface are its arguments; its defaults are recorded
    if they are JSON values.
    """
    if algo in SETTINGS:
        return SETTINGS[algo]
    kind = find_class(algo)
    if issubclass(kind, Agent | Rule):
        settings: type[Settings] = kind.Settings
        return settings
    fields: dict[str, Any] = {}
    for name, argument in inspect.signature(kind.__init__).parameters.items():
        is_setting = name not in _NOT_SETTINGS and not name.startswith("_")
        if is_setting and not name.endswith("_class") and argument.kind not in _ANY_NUMBER:
            given = argument.default if _is_json(argument.default) else omissible(_NOT_RECORDED)
            fields[name] = Any, given
    return create_model(kind.__name__, __base__=Settings, **fields)


def describe_settings(algo: str) -> dict[str, tuple[Any, str]]:
    """Returns the default (JSON or "required") and the meaning of each setting of an algorithm."""
    kind = settings_class(algo)
    return {
        name: (
            "required"
            if field.is_required()
            else to_jsonable_python(field.get_default(call_default_factory=True)),
            _meaning(kind, name),
        )
        for name, field in kind.model_fields.items()
        if field.default is not _NOT_RECORDED
    }


def _meaning(kind: type[Settings], name: str) -> str:
    """Returns the description of a setting; a subclass adds the source of its own default."""
    classes = [base for base in reversed(kind.__mro__) if issubclass(base, Settings)]
    fields = [base.model_fields[name] for base in classes if name in base.model_fields]
    parts = [part for field in fields for part in (field.description or "").split("; ")]
    return "; ".join(dict.fromkeys(filter(None, parts)))


def choose_engine(algo: str, wanted: Engine | None = None) -> Engine:
    """Returns the engine that trains an algorithm, by default the one that follows from it.

    Raises:
        RequestError: if there is no such algorithm, or it has another engine.
        WorkError: if an agent and an update rule have this name.
    """
    if algo in SETTINGS:
        if wanted == "plugin":
            raise RequestError(f"{algo} is not an agent of another package: type batched or sb3.")
        return wanted or "batched"
    if plugins.is_imported(algo):
        kind = plugins.imported("algorithm", algo)
        bases = kind.__mro__ if isinstance(kind, type) else ()
        engine: Engine = "plugin" if Agent in bases else "batched" if Rule in bases else "sb3"
    else:
        engine = GROUPS[_entry_point(algo).group]
    if wanted not in (None, engine):
        raise RequestError(f"{algo} has the engine {engine}, not {wanted}; leave the engine out.")
    return engine


def algorithm_fields(
    algo: str,
    engine: Engine | None = None,
    base: Base | None = None,
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
    fields: dict[str, Any] = {"algo": algo, "engine": choose_engine(algo, engine)}
    changes = dict(overrides or {})
    if algo in SETTINGS:
        ours = algorithm_settings(algo, default_base(task, base), changes)
        return fields | {"hyperparameters": ours.model_dump(mode="json")}
    if base not in (None, "published"):
        raise RequestError(
            f"The settings {base} are for {', '.join(SETTINGS)}; {algo} has its own defaults."
        )
    settings = settings_with(settings_class(algo), algo, changes)
    return fields | {
        "hyperparameters": settings.model_dump(mode="json"),
        "package": None if plugins.is_imported(algo) else plugins.distribution(_entry_point(algo)),
    }


def hyperparameters(run: RunSettings) -> Settings:
    """Returns the hyperparameters of a run as an object; see `settings_class`."""
    return settings_with(settings_class(run.algo), run.algo, run.hyperparameters)


def algorithm_provenance(algo: str) -> dict[str, str | None]:
    """Returns provenance of the code of an algorithm; none for those of jbench."""
    if algo in SETTINGS:
        return {}
    if not plugins.is_imported(algo):
        _entry_point(algo)
    return plugins.provenance("algorithm", algo, installed())


def _offered() -> list[EntryPoint]:
    return [point for g in GROUPS for point in plugins.offered(g, _NAME, SETTINGS).values()]


def _entry_point(name: str) -> EntryPoint:
    offered = _offered()
    points = [point for point in offered if point.name == name]
    if not points and name.lower() in _ELSEWHERE:
        raise RequestError(f"Unknown algorithm {name!r}; {_ELSEWHERE[name.lower()]}.")
    try:
        known("algorithm", name, [*SETTINGS, *sorted({point.name for point in offered})])
    except RequestError as error:
        raise RequestError(
            f"{str(error).rstrip('.')}, install the package of another agent, or type MODULE:CLASS."
        ) from None
    if len(points) > 1:
        agent, rule = map(plugins.distribution, points)
        raise WorkError(f"{name} is an agent of {agent} and a rule of {rule}; uninstall one.")
    return points[0]


def _is_json(value: Any) -> bool:
    try:
        canonical_json({"value": value})
    except (TypeError, ValueError):
        return False
    return True
