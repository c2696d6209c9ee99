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
from jbench.names import ALGORITHMS, Base, Engine, known
from jbench.settings.algorithms import SETTINGS, OffPolicySettings, algorithm_settings
from jbench.settings.base import Settings, settings_with

GROUPS: dict[str, Engine] = {"jbench.agents": "plugin", "jbench.rules": "batched"}
"""Groups of entry points, agents and update rules, and the engine that trains each."""

_NAME = re.compile(r"[a-z][a-z0-9-]*")


def installed() -> dict[str, EntryPoint]:
    """Returns the entry points of the installed agents and update rules by name."""
    groups = (plugins.offered(group, _NAME, ALGORITHMS) for group in GROUPS)
    return dict(sorted({name: point for group in groups for name, point in group.items()}.items()))


def find_agent(name: str) -> type[Agent]:
    """Returns the class of an installed agent.

    Raises:
        RequestError: if there is no such agent.
        WorkError: if its package can't be imported, or its class is not an agent.
    """
    kind = _load("agent", name)
    if not (isinstance(kind, type) and issubclass(kind, Agent)) or inspect.isabstract(kind):
        raise WorkError(
            f"The agent {name} is no subclass of jbench.Agent with explore, act and learn; mend or "
            "uninstall the package that offers it."
        )
    if not issubclass(kind.Settings, AgentSettings):
        raise WorkError(f"Settings of the agent {name} is no subclass of jbench.AgentSettings.")
    return kind


def find_rule(name: str) -> type[Rule]:
    """Returns the class of an installed update rule.

    Raises:
        RequestError: if there is no such rule.
        WorkError: if its package can't be imported, or its class is not a rule.
    """
    kind = _load("rule", name)
    if not (isinstance(kind, type) and issubclass(kind, Rule)):
        raise WorkError(
            f"The rule {name} is no subclass of jbench.Rule; mend or uninstall the package that "
            "offers it."
        )
    if not issubclass(kind.Settings, OffPolicySettings):
        raise WorkError(f"Settings of the rule {name} is no subclass of jbench.OffPolicySettings.")
    return kind


def check_name(name: str) -> None:
    """Raises a RequestError that lists the algorithms if there is none of this name."""
    if name in ALGORITHMS or plugins.is_imported(name):
        return
    try:
        known("algorithm", name, [*ALGORITHMS, *installed()])
    except RequestError as error:
        raise RequestError(
            f"{str(error).rstrip('.')}; an agent of another package must be installed here, and "
            "MODULE:CLASS names a class with the interface of stable-baselines3."
        ) from None


def settings_of(algo: str) -> dict[str, tuple[Any, str]]:
    """Returns the default, as a JSON value, and the meaning of each setting of an algorithm.

    The default of a setting that must be given is "required".

    Raises:
        RequestError: if there is no such algorithm.
        WorkError: if its package can't be imported.
    """
    check_name(algo)
    if plugins.is_imported(algo):
        from jbench.agents import sb3_classes  # stable-baselines3 takes a second to import

        defaults = sb3_classes.settings_of(algo, {})
        return {name: (default, "") for name, default in defaults.items()}
    kind: type[Settings] = SETTINGS[algo] if algo in SETTINGS else _settings_class(algo)
    return {
        name: (
            "required"
            if field.is_required()
            else to_jsonable_python(field.get_default(call_default_factory=True)),
            field.description or "",
        )
        for name, field in kind.model_fields.items()
    }


def engine_of(algo: str, wanted: Engine | None = None) -> Engine:
    """Returns the engine that trains an algorithm.

    Args:
        wanted: as typed by the user; None for the engine that follows from the algorithm.

    Raises:
        RequestError: if there is no such algorithm, or it has another engine.
    """
    check_name(algo)
    if algo in ALGORITHMS:
        if wanted == "plugin":
            raise RequestError(f"{algo} is not an agent of another package: type batched or sb3.")
        return wanted or "batched"
    engine: Engine = "sb3" if plugins.is_imported(algo) else GROUPS[installed()[algo].group]
    if wanted not in (None, engine):
        raise RequestError(f"{algo} has the engine {engine}, not {wanted}; leave the engine out.")
    return engine


def algorithm_fields(
    algo: str,
    engine: Engine | None = None,
    base: Base = "published",
    overrides: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Returns the fields of `RunSettings` that describe an algorithm.

    Args:
        algo: one of `jbench.names.ALGORITHMS`, an installed agent or rule, or MODULE:CLASS.
        engine: as typed by the user; None for the engine that follows from the algorithm.
        base: source of the defaults of jbench's own algorithms.
        overrides: hyperparameters by name that replace them.

    Raises:
        RequestError: if there is no such algorithm, or a setting is unknown or invalid.
        WorkError: if the package of an agent can't be imported.
    """
    fields: dict[str, Any] = {"algo": algo, "engine": engine_of(algo, engine)}
    changes = dict(overrides or {})
    if algo in ALGORITHMS:
        own = algorithm_settings(algo, base, changes)
        return fields | {"hyperparameters": own.model_dump(mode="json")}
    if base != "published":
        raise RequestError(
            f"The settings {base} are for {', '.join(ALGORITHMS)}; {algo} has its own defaults."
        )
    if fields["engine"] == "sb3":
        from jbench.agents import sb3_classes

        return fields | {"hyperparameters": sb3_classes.settings_of(algo, changes)}
    settings = settings_with(_settings_class(algo), algo, changes)
    return fields | {
        "hyperparameters": settings.model_dump(mode="json"),
        "package": plugins.package_of(installed()[algo]),
    }


def code_of(algo: str) -> dict[str, str | None]:
    """Returns provenance of the code of an algorithm; none for those of jbench.

    Raises:
        RequestError: if there is no such algorithm.
    """
    check_name(algo)
    if algo in ALGORITHMS:
        return {}
    return plugins.code_of("algorithm", algo, installed())


def _settings_class(name: str) -> type[AgentSettings | OffPolicySettings]:
    """Returns the class of the settings of an installed agent or update rule."""
    check_name(name)
    is_rule = GROUPS[installed()[name].group] == "batched"
    return find_rule(name).Settings if is_rule else find_agent(name).Settings


def _load(what: str, name: str) -> Any:
    """Returns what the entry point of an agent or a rule names."""
    check_name(name)
    offers = {group: plugins.offered(group, _NAME, ALGORITHMS) for group in GROUPS}
    if all(name in points for points in offers.values()):
        packages = [str(plugins.package_of(points[name])) for points in offers.values()]
        raise WorkError(
            f"{name} is an agent of {packages[0]} and a rule of {packages[1]}; uninstall one."
        )
    return plugins.load(what, installed()[name])
