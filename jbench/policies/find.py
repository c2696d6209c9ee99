"""Policies by name: random, constant, heuristic, trained, or of another package.

Other packages offer policies as entry points of the group `jbench.policies`, and modules in the
working directory as MODULE:NAME. A policy is an `Actor`, or an object with `act` and optionally
`reset(robots)`. A class is called with the name of the task, and its object is the policy.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import EntryPoint
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench import plugins
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, sentence_of_failure
from jbench.names import HEURISTIC, POLICIES, POLICY_NAMES, REFERENCE
from jbench.policies.actors import acting
from jbench.policies.located import SHIPPED, locate_run
from jbench.policies.saved import load_agent
from jbench.policies.sb3_zip import is_sb3_zip, read_sb3_zip
from jbench.settings.recorded import Run, read_run
from jbench.store import Results
from jbench.tasks.find import find_task
from jbench.tasks.task import Act
from jbench.typed_values import closest, suggested

_OURS = (*POLICIES, REFERENCE)

_CONSTANT = "constant:"

_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)(e-?\d+)?", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class ActingPolicy:
    """A policy: actions (robots, action_size) in [-1, 1] for observations (robots, dim(O)).

    `reset` takes a number of robots, and starts an episode of each.
    """

    act: Act
    reset: Callable[[int], object] = lambda robots: None


def find_policy(
    results: Results, name: str, task: str, seed: int = 0, accept_changed: bool = False
) -> ActingPolicy:
    """Returns a policy by its full name, see `POLICY_NAMES`; the seed is of the random policy.

    Raises a RequestError if there is no such policy, it was trained on another task, or the code of
    its task or encoder has changed, unless that is accepted, and a WorkError if the policy of
    another package can't be imported.
    """
    if name == HEURISTIC:
        policy = find_task(task).hand_written()
        if policy is None:
            raise RequestError(
                f"There is no hand-written policy of {task}; choose random, constant:U, a trained "
                "policy, or MODULE:NAME."
            )

        return ActingPolicy(policy.act, policy.reset)

    size = find_task(task).action_size
    if name == "random":  # as in the random-policy dataset
        random = np.random.default_rng(np.random.SeedSequence(seed))
        return ActingPolicy(lambda observations: random.uniform(-1, 1, (len(observations), size)))
    if name.startswith(_CONSTANT):
        command = _constant(name)
        return ActingPolicy(lambda observations: np.full((len(observations), size), command))
    if is_imported_policy(name):
        return _imported_policy(name, task)
    if is_sb3_zip(name):
        return ActingPolicy(read_sb3_zip(name, task).act)

    run = locate_run(results, name)
    agent = load_agent(run.results, run.id, accept_changed)
    if agent.task != task:
        raise RequestError(
            f"The run {run.id} was trained on {agent.task}, not {task}; type --task {agent.task}."
        )

    return ActingPolicy(agent.act)


def _constant(name: str) -> float:
    """Returns the command of a policy such as `constant:0.5`."""
    text = name.removeprefix(_CONSTANT)
    # Python also reads 0_1 and +1, but the name is part of an evaluation's id.
    if not _NUMBER.fullmatch(text) or not -1 <= float(text) <= 1:
        raise RequestError(
            f"{name}: a constant command lies in [-1, 1]; type constant:0.5, for example."
        )
    return float(text)


def is_imported_policy(name: str) -> bool:
    """Returns whether a name is that of an installed policy, or of the form MODULE:NAME."""
    is_ours = name.partition(":")[0] in _OURS
    return not is_ours and (plugins.is_imported(name) or name in offered_policies())


def offered_policies() -> dict[str, EntryPoint]:
    """Returns the entry points of the policies of other packages by name."""
    return plugins.offered("jbench.policies", re.compile(r"[a-z][a-z0-9-]*"), _OURS)


def _imported_policy(name: str, task: str) -> ActingPolicy:
    """Returns a policy of another package, whose actions are checked, after it has acted once.

    Raises a RequestError if it does not exist, or its actions have the wrong shape or are not
    finite; a WorkError if its module, its class or its actions raise an error.
    """
    sizes = find_task(task)

    def attempt(function: Callable[[Any], Any], argument: object) -> Any:
        """Returns what a function of the policy returns; its errors are a WorkError."""
        try:
            return function(argument)
        except (RequestError, WorkError):
            raise
        except ERRORS_OF_OTHERS as error:
            raise WorkError(f"The policy {name} failed ({sentence_of_failure(error)}).") from error

    if plugins.is_imported(name):
        policy = plugins.imported("policy", name)
    else:
        policy = plugins.load("policy", offered_policies()[name])
    if isinstance(policy, type):
        policy = attempt(policy, task)

    actor = getattr(policy, "act", policy)

    def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns checked actions (robots, action_size), clipped to [-1, 1]."""
        with acting(actor, sizes.action_size) as checked:
            actions: NDArray[np.floating] = attempt(checked, observations)
        return actions.clip(-1, 1)

    reset = partial(attempt, getattr(policy, "reset", lambda robots: None))
    checked_policy = ActingPolicy(act, reset)
    checked_policy.reset(1)
    checked_policy.act(np.zeros((1, sizes.observation_size), np.float32))
    return checked_policy


class FullName(NamedTuple):
    """The whole name of a policy, and the settings of its run, if it is one of a run."""

    name: str
    run: Run | None


def full_name(results: Results, name: str) -> FullName:
    """Completes a policy's name to the whole id of its run; returns its settings, too, if any.

    `reference/face_direction/ddpg/full` is short for the only shipped policy of these runs, and
    `face_direction/ddpg` for the only such run of the results. Raises a RequestError if there is no
    such policy, its command is wrong, or several runs match, and a WorkError if the run's manifest
    can't be read.
    """
    plugins.refuse_path(name)
    if "/" in name and not is_sb3_zip(name):
        run = locate_run(results, name)
        whole_name = run.id
        if name.startswith(SHIPPED):
            whole_name = f"{SHIPPED}{run.id}"

        record = run.results.find("run", run.id)
        if record is None:
            return FullName(whole_name, None)
        return FullName(whole_name, read_run(record.settings))

    if name == _CONSTANT.rstrip(":"):
        raise RequestError("constant is a command in [-1, 1]; type constant:0.5, for example.")
    if name.startswith(_CONSTANT):
        _constant(name)
    elif not (name in (HEURISTIC, "random") or is_sb3_zip(name) or is_imported_policy(name)):
        close = closest(name, [*POLICIES, *offered_policies()])
        advice = suggested(close, f"choose {POLICY_NAMES}")
        raise RequestError(f"Unknown policy {name!r}; {advice}.")

    return FullName(name, None)
