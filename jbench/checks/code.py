"""What `jbench check` does with a task, an agent, an update rule, an encoder or a policy of others.

Each is run through what jbench will demand of it, with short episodes.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal, get_args

from jbench import plugins
from jbench.agents.batched.rule import Rule
from jbench.agents.find import installed
from jbench.agents.plugin import Agent
from jbench.checks import agents, encoders, policies, tasks
from jbench.checks.checked import Checked, NamedCheck, attempt
from jbench.cores import one_thread
from jbench.encoders.kind import Kind
from jbench.encoders.registry import kind_names
from jbench.errors import RequestError
from jbench.policies.find import offered_policies
from jbench.settings.algorithms import SETTINGS
from jbench.task_specs import GYM, SUITE, SUITE_TASKS
from jbench.tasks.find import advice_on_module, installed_tasks
from jbench.typed_values import closest, suggested

CodeKind = Literal["task", "agent", "rule", "encoder", "policy"]
KINDS: tuple[CodeKind, ...] = get_args(CodeKind)

_ESSENTIAL = ("class", "made", "actions", "learning", "episode", "training", "acts")
"""Checks without which the later ones would fail for the same reason."""

_ENVIRONMENT = ("reset", "step", "observation_spec", "action_spec")
"""Methods of a `dm_env.Environment`."""

_GYMNASIUM = ("reset", "step", "observation_space", "action_space")
"""Methods and attributes of a `gymnasium.Env`."""


@dataclass(frozen=True)
class CheckRequest:
    """What to check, and on which task with which settings."""

    name: str
    task: str
    settings: Mapping[str, Any]
    latents: int | None = None


def check_code(kind: CodeKind, request: CheckRequest) -> Iterator[Checked]:
    """Yields a line for each check.

    Raises a RequestError if settings or a number of latents are given that this kind of code does
    not have.
    """
    if request.settings and kind in ("task", "policy"):
        raise RequestError(f"{request.name} is a {kind}, which has no settings: leave --set out.")
    if request.latents is not None and kind != "encoder":
        raise RequestError(f"{request.name} is no encoder: leave --latent out.")

    return _lines(kind, request)


def _lines(kind: CodeKind, request: CheckRequest) -> Iterator[Checked]:
    """Yields a line for each check."""
    with one_thread():
        for name, check in _checks(kind, request):
            line = attempt(name, check)
            yield line
            if line.state == "fails" and name in _ESSENTIAL:
                return


def _checks(kind: CodeKind, request: CheckRequest) -> Iterator[NamedCheck]:
    """Returns the checks of a kind of code."""
    name = request.name
    task = request.task
    settings = request.settings
    if kind == "task":
        return tasks.checks(name)
    if kind == "agent":
        return agents.agent_checks(name, task, settings)
    if kind == "rule":
        return agents.rule_checks(name, task, settings)
    if kind == "encoder":
        return encoders.checks(name, task, settings, request.latents)

    return policies.checks(name, task)


def kind_of_code(name: str) -> CodeKind:
    """Returns what MODULE:NAME or an installed name is.

    Raises a RequestError if there is none of that name, or jbench does not check what it is, and a
    WorkError if it can't be imported.
    """
    if name.startswith((SUITE, GYM)):
        return "task"
    if not plugins.is_imported(name):
        return _installed(name)

    found = plugins.imported("class", name)
    bases: dict[CodeKind, type] = {"agent": Agent, "rule": Rule, "encoder": Kind}
    if isinstance(found, type):
        for kind, base in bases.items():
            if issubclass(found, base):
                return kind
        if all(hasattr(found, method) for method in _ENVIRONMENT):
            return "task"

        from stable_baselines3.common.base_class import BaseAlgorithm  # takes a second to import

        if issubclass(found, BaseAlgorithm):
            raise RequestError(
                f"{name} is a class of stable-baselines3, whose training loop is its own: type "
                f"jbench train --algo {name} --seeds 0 --steps 4k --results trial, which tries it."
            )

    elif _is_environment(found):
        raise RequestError(
            f"{name} is an environment of type {type(found).__name__}, and jbench makes several: "
            "type MODULE:NAME of the function that returns it."
        )

    if callable(found) and not hasattr(found, "act") and _is_factory(found):
        return "task"

    return "policy"


def _is_environment(found: object) -> bool:
    """Returns whether an object is a `gymnasium.Env` or a `dm_env.Environment`."""
    is_of_gymnasium = all(hasattr(found, name) for name in _GYMNASIUM)
    return is_of_gymnasium or all(hasattr(found, method) for method in _ENVIRONMENT)


def _is_factory(found: Callable[..., Any]) -> bool:
    """Returns whether a function can be called without arguments, or with a seed `random` only."""
    parameters = plugins.parameters(found)
    if parameters is None:
        return False

    needed = {name for name, each in parameters.items() if each.default is inspect.Parameter.empty}
    return needed <= {"random"}


def _installed(name: str) -> CodeKind:
    """Returns what an installed name is: a task, an agent, a rule, an encoder or a policy."""
    points = installed()
    by_kind: dict[CodeKind, list[str]] = {
        "agent": [each for each, point in points.items() if point.group == "jbench.agents"],
        "rule": [each for each, point in points.items() if point.group == "jbench.rules"],
        "encoder": kind_names(),
        "task": list(installed_tasks()),
        "policy": list(offered_policies()),
    }
    for kind, names in by_kind.items():
        if name in names:
            return kind

    if name in SETTINGS:
        raise RequestError(f"{name} is jbench's own; type MODULE:CLASS of an algorithm of yours.")

    plugins.refuse_path(name)
    advice = advice_on_module(name, "a function or a class in it")
    if advice:
        raise RequestError(f"There is no code called {name!r}; {advice}.")

    close = closest(name, [*SUITE_TASKS, *chain.from_iterable(by_kind.values())])
    advice = suggested(
        close,
        "type MODULE:NAME of a task, an agent, an update rule, an encoder or a policy of yours, "
        "the name of an installed one, or a task such as dmc:cheetah-run or gym:Hopper-v5",
    )
    raise RequestError(f"There is no code called {name!r}; {advice}.")
