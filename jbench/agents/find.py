"""Algorithms of other packages and of users by name: agents, update rules, classes as of sb3."""

import inspect
import re
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from jbench import plugins
from jbench.agents.batched.rule import Rule
from jbench.agents.plugin import Agent, AgentSettings
from jbench.errors import RequestError, WorkError
from jbench.names import EngineName
from jbench.settings.algorithms import SETTINGS, OffPolicySettings
from jbench.settings.base import Settings
from jbench.typed_values import known


@dataclass(frozen=True)
class _Group:
    """A group of entry points, by which packages offer algorithms.

    Attributes:
        what: what is offered, in errors.
        base: class of which it is a subclass.
        settings: class of which its `Settings` are a subclass.
        engine: which trains it.
        methods: those that it must have, in errors.
    """

    what: str
    base: type
    settings: type[Settings]
    engine: EngineName
    methods: str = ""


_GROUPS = {
    "jbench.agents": _Group(
        "agent", Agent, AgentSettings, "plugin", methods=" with explore, act and learn"
    ),
    "jbench.rules": _Group("rule", Rule, OffPolicySettings, "batched"),
}
"""By the name of the group."""

_ENGINE_OF_OTHERS: EngineName = "sb3"
"""The engine of classes that are in no group, which have the interface of stable-baselines3."""

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
    return {point.name: point for point in _offered()}


def find_class(name: str) -> Any:
    """Returns the class of an algorithm that is not jbench's: an `Agent`, a `Rule` or of sb3.

    Raises:
        RequestError: if there is none of this name.
        WorkError: if its package can't be imported, its class is no agent or rule, or an agent and
            an update rule have this name.
    """
    if not plugins.is_imported(name):
        point = _entry_point(name)
        group = _GROUPS[point.group]
        return _checked(name, plugins.load(group.what, point), group)

    kind = plugins.imported("algorithm", name)
    group_of_kind = _group(kind)
    if group_of_kind is not None:
        return _checked(name, kind, group_of_kind)

    from stable_baselines3.common.base_class import BaseAlgorithm  # takes a second to import

    if BaseAlgorithm not in _bases(kind):
        raise RequestError(
            f"{name} is no subclass of jbench.Agent, jbench.Rule or stable-baselines3's "
            "BaseAlgorithm; record its training loop with jbench.record (docs/recording.md)."
        )

    return kind


def find_engine(name: str) -> EngineName:
    """Returns the engine that trains an algorithm that is not jbench's; raises as `find_class`."""
    group = _group(find_class(name))
    return _ENGINE_OF_OTHERS if group is None else group.engine


def _group(kind: Any) -> _Group | None:
    """Returns the group of agents or update rules to which a class belongs; None if to neither."""
    bases = _bases(kind)
    return next((group for group in _GROUPS.values() if group.base in bases), None)


def _bases(kind: Any) -> tuple[type, ...]:
    """Returns a class and those from which it derives; none of what is no class."""
    return inspect.getmro(kind) if isinstance(kind, type) else ()


def _checked(name: str, kind: Any, group: _Group) -> Any:
    """Returns the class of an agent or an update rule; a WorkError if it is none."""
    is_subclass = isinstance(kind, type) and issubclass(kind, group.base) and kind is not group.base
    if not is_subclass or inspect.isabstract(kind):
        advice = "fix it"
        if not plugins.is_imported(name):
            advice = "fix it, or uninstall the package that offers it"
        raise WorkError(
            f"The {group.what} {name} is no subclass of jbench.{group.base.__name__}"
            f"{group.methods}; {advice}."
        )

    if not (isinstance(kind.Settings, type) and issubclass(kind.Settings, group.settings)):
        raise WorkError(
            f"Settings of the {group.what} {name} is no subclass of "
            f"jbench.{group.settings.__name__}."
        )

    return kind


def algorithm_provenance(algo: str) -> dict[str, Any]:
    """Returns provenance of the code of an algorithm; none for those of jbench."""
    if algo in SETTINGS:
        return {}
    points = {} if plugins.is_imported(algo) else {algo: _entry_point(algo)}
    return plugins.code_provenance("algorithm", algo, points)


def package_and_version(name: str) -> str | None:
    """Returns name and version of the package that offers an algorithm; None for MODULE:CLASS."""
    return None if plugins.is_imported(name) else plugins.distribution(_entry_point(name))


def _offered() -> list[EntryPoint]:
    """Returns the entry points of installed algorithms, by name."""
    points: list[EntryPoint] = []
    for group in _GROUPS:
        points += plugins.offered(group, _NAME, SETTINGS).values()
    return sorted(points, key=lambda point: point.name)


def _entry_point(name: str) -> EntryPoint:
    """Returns the entry point of an algorithm; a RequestError says what was meant."""
    points = [point for point in _offered() if point.name == name]
    plugins.refuse_path(name)
    if not points and name.lower() in _ELSEWHERE:
        raise RequestError(f"Unknown algorithm {name!r}; {_ELSEWHERE[name.lower()]}.")

    try:
        known("algorithm", name, [*SETTINGS, *installed()])
    except RequestError as error:
        raise RequestError(
            f"{str(error).rstrip('.')}, install the package of another agent, or type MODULE:CLASS."
        ) from None

    if len(points) > 1:
        agent, rule = map(plugins.distribution, points)
        raise WorkError(f"{name} is an agent of {agent} and a rule of {rule}; uninstall one.")

    return points[0]
