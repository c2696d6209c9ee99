"""Algorithms by name: jbench's, those of other packages, and stable-baselines3-like classes."""

import inspect
import re
from collections.abc import Mapping
from importlib.metadata import EntryPoint
from typing import Any

from pydantic_core import to_jsonable_python

from jbench import plugins
from jbench.agents.batched.rule import Rule
from jbench.agents.plugin import Agent, AgentSettings
from jbench.errors import RequestError, WorkError
from jbench.names import TASKS, Base, Engine, known
from jbench.settings.algorithms import (
    ALGORITHMS,
    SETTINGS,
    OffPolicySettings,
    algorithm_settings,
    default_base,
)
from jbench.settings.base import Settings, settings_with
from jbench.settings.run import RunSettings

GROUPS: dict[str, Engine] = {"jbench.agents": "plugin", "jbench.rules": "batched"}
"""Groups of entry points, agents and update rules, and the engine that trains each."""

_NAME = re.compile(r"[a-z][a-z0-9-]*")

_ELSEWHERE = {
    "a2c": "use --algo stable_baselines3:A2C",
    "tqc": "use --algo sb3_contrib:TQC",
    "trpo": "use --algo sb3_contrib:TRPO",
    "dqn": "it needs discrete actions, but those of all tasks are continuous",
}
"""Algorithms of other packages whose names are like those of jbench's, and what to do instead."""


def installed() -> dict[str, EntryPoint]:
    """Returns the entry points of the installed agents and update rules by name."""
    agents, rules = _offered()
    return dict(sorted({**agents, **rules}.items()))


def find_class(name: str) -> type[Agent] | type[Rule]:
    """Returns the class of an agent or update rule, installed or MODULE:CLASS.

    Raises:
        RequestError: if there is none of this name.
        WorkError: if its package can't be imported, or its class is no agent or rule.
    """
    is_rule = _engine_of_other(name) == "batched"
    what, base, settings = (
        ("rule", Rule, OffPolicySettings) if is_rule else ("agent", Agent, AgentSettings)
    )
    is_imported = plugins.is_imported(name)
    kind = plugins.imported(what, name) if is_imported else plugins.load(what, _entry_point(name))
    is_subclass = isinstance(kind, type) and issubclass(kind, base) and kind is not base
    if not is_subclass or inspect.isabstract(kind):
        methods = "" if is_rule else " with explore, act and learn"
        raise WorkError(
            f"The {what} {name} is no subclass of jbench.{base.__name__}{methods}; fix it, or "
            "uninstall the package that offers it."
        )
    if not (isinstance(kind.Settings, type) and issubclass(kind.Settings, settings)):
        raise WorkError(
            f"Settings of the {what} {name} is no subclass of jbench.{settings.__name__}."
        )
    found: type[Agent] | type[Rule] = kind
    return found


def describe_settings(algo: str) -> dict[str, tuple[Any, str]]:
    """Returns the default, as a JSON value, and the meaning of each setting of an algorithm.

    The default of a setting that must be given is "required".

    Raises:
        RequestError: if there is no such algorithm.
        WorkError: if its package can't be imported.
    """
    if choose_engine(algo) == "sb3":
        from jbench.agents import sb3_classes  # stable-baselines3 takes a second to import

        defaults = sb3_classes.class_settings(algo, {})
        return {name: (default, "") for name, default in defaults.items()}
    kind: type[Settings] = SETTINGS[algo] if algo in SETTINGS else find_class(algo).Settings
    return {
        name: (
            "required"
            if field.is_required()
            else to_jsonable_python(field.get_default(call_default_factory=True)),
            _meaning(kind, name),
        )
        for name, field in kind.model_fields.items()
    }


def _meaning(kind: type[Settings], name: str) -> str:
    """Returns the description of a setting; a subclass adds the source of its own default."""
    classes = [each for each in reversed(kind.__mro__) if issubclass(each, Settings)]
    fields = [each.model_fields[name] for each in classes if name in each.model_fields]
    parts = [part for field in fields for part in (field.description or "").split("; ")]
    return "; ".join(dict.fromkeys(filter(None, parts)))


def choose_engine(algo: str, wanted: Engine | None = None) -> Engine:
    """Returns the engine that trains an algorithm.

    Args:
        wanted: as typed by the user; None for the engine that follows from the algorithm.

    Raises:
        RequestError: if there is no such algorithm, or it has another engine.
        WorkError: if an agent and an update rule have this name.
    """
    if algo in ALGORITHMS:
        if wanted == "plugin":
            raise RequestError(f"{algo} is not an agent of another package: type batched or sb3.")
        return wanted or "batched"
    engine = _engine_of_other(algo)
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
        algo: one of `ALGORITHMS`, an installed agent or rule, or MODULE:CLASS.
        engine: as typed by the user; None for the engine that follows from the algorithm.
        base: source of the defaults of jbench's own algorithms; None for that of the task.
        overrides: hyperparameters by name that replace them.
        task: whose defaults are taken if no base is given.

    Raises:
        RequestError: if there is no such algorithm, or a setting is unknown or invalid.
        WorkError: if the package of an agent can't be imported.
    """
    fields: dict[str, Any] = {"algo": algo, "engine": choose_engine(algo, engine)}
    changes = dict(overrides or {})
    if algo in ALGORITHMS:
        own = algorithm_settings(algo, default_base(task, base), changes)
        return fields | {"hyperparameters": own.model_dump(mode="json")}
    if base not in (None, "published"):
        raise RequestError(
            f"The settings {base} are for {', '.join(ALGORITHMS)}; {algo} has its own defaults."
        )
    if fields["engine"] == "sb3":
        from jbench.agents import sb3_classes

        return fields | {"hyperparameters": sb3_classes.class_settings(algo, changes)}
    settings = settings_with(find_class(algo).Settings, algo, changes)
    return fields | {
        "hyperparameters": settings.model_dump(mode="json"),
        "package": None if plugins.is_imported(algo) else plugins.distribution(_entry_point(algo)),
    }


def hyperparameters(run: RunSettings) -> Settings:
    """Returns the hyperparameters of a run of the batched engine or of an agent as an object.

    Raises:
        RequestError: if its agent or update rule is not installed.
        WorkError: if the package of the agent or rule can't be imported.
    """
    if run.is_ours:
        return run.algorithm
    return settings_with(find_class(run.algo).Settings, run.algo, run.hyperparameters)


def algorithm_provenance(algo: str) -> dict[str, str | None]:
    """Returns provenance of the code of an algorithm; none for those of jbench.

    Raises:
        RequestError: if there is no such algorithm.
    """
    if algo in ALGORITHMS:
        return {}
    if not plugins.is_imported(algo):
        _entry_point(algo)
    return plugins.provenance("algorithm", algo, installed())


def _offered() -> list[dict[str, EntryPoint]]:
    """Returns the entry points of the agents and those of the update rules, by name."""
    return [plugins.offered(group, _NAME, ALGORITHMS) for group in GROUPS]


def _entry_point(name: str) -> EntryPoint:
    """Returns the entry point of an agent or an update rule.

    Raises:
        RequestError: if there is none.
        WorkError: if an agent and a rule have the name.
    """
    agents, rules = _offered()
    if name.lower() in _ELSEWHERE and name not in {**agents, **rules}:
        raise RequestError(f"Unknown algorithm {name!r}; {_ELSEWHERE[name.lower()]}.")
    try:
        known("algorithm", name, [*ALGORITHMS, *sorted({*agents, *rules})])
    except RequestError as error:
        raise RequestError(
            f"{str(error).rstrip('.')}, install the package of another agent, or type MODULE:CLASS."
        ) from None
    if name in agents and name in rules:
        packages = [plugins.distribution(points[name]) for points in (agents, rules)]
        raise WorkError(
            f"{name} is an agent of {packages[0]} and a rule of {packages[1]}; uninstall one."
        )
    return {**agents, **rules}[name]


def _engine_of_other(name: str) -> Engine:
    """Returns the engine of an algorithm that is not jbench's; MODULE:CLASS is imported."""
    if not plugins.is_imported(name):
        return GROUPS[_entry_point(name).group]
    kind = plugins.imported("algorithm", name)
    if isinstance(kind, type) and issubclass(kind, Agent):
        return "plugin"
    return "batched" if isinstance(kind, type) and issubclass(kind, Rule) else "sb3"
