"""Policies by name: random, constant, heuristic, trained, or of another package."""

import re
from difflib import get_close_matches
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.names import HEURISTIC, POLICIES, POLICY_NAMES, REFERENCE, TASKS, closest
from jbench.policies.imported import ImportedPolicy, installed_policies, is_imported_policy
from jbench.policies.saved import TrainedAgent, has_policy, load_agent
from jbench.policies.sb3_zip import is_sb3_zip, read_sb3_zip
from jbench.settings.recorded import read_run
from jbench.simulation import Act, find_task
from jbench.store import Record, Results
from jbench.store.shipped import shipped_results
from jbench.tasks.heuristics import heuristic

SHIPPED = f"{REFERENCE}/"
"""Prefix of the names of shipped policies; the id of the run follows."""

_CONSTANT = "constant:"
_NUMBER = re.compile(r"-?(\d+\.?\d*|\.\d+)(e-?\d+)?", re.ASCII | re.IGNORECASE)


class ActingPolicy(Protocol):
    """A policy for a batch of robots, acting on the observations of its task."""

    def reset(self, robots: int) -> None:
        """Starts new episodes of this many robots."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns actions (robots, action_size) in [-1, 1] for observations (robots, dim(O))."""


class _Stateless:
    """A policy that keeps nothing from one control step to the next."""

    def __init__(self, act: Act) -> None:
        self._act = act

    def reset(self, robots: int) -> None:
        pass

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        return self._act(observations)


def find_policy(results: Results, name: str, task: str, seed: int = 0) -> ActingPolicy:
    """Returns a policy by name.

    Args:
        name: see `jbench.names.POLICY_NAMES`.
        seed: of the random policy.

    Raises:
        RequestError: if there is no such policy, or it was trained on another task.
        WorkError: if the policy of another package can't be imported.
    """
    if name == HEURISTIC:
        if task not in TASKS:
            raise RequestError(
                f"There is no hand-written policy of {task}; choose random, constant:U, a trained "
                "policy, or MODULE:NAME."
            )
        return heuristic(task)
    size = find_task(task).action_size
    if name == "random":  # as in the random-policy dataset
        random = np.random.default_rng(np.random.SeedSequence(seed))
        return _Stateless(lambda observations: random.uniform(-1, 1, (len(observations), size)))
    if name.startswith(_CONSTANT):
        command = _constant(name)
        return _Stateless(lambda observations: np.full((len(observations), size), command))
    if is_imported_policy(name):
        return ImportedPolicy(name, task)
    if is_sb3_zip(name):
        return _Stateless(read_sb3_zip(name, task).act)
    if "/" not in name:
        raise _unknown(name)
    run, agent = find_trained_agent(results, name)
    if agent.task != task:
        raise RequestError(
            f"The run {run} was trained on {agent.task}, not {task}; type --task {agent.task}."
        )
    return _Stateless(agent.act)


def _constant(name: str) -> float:
    """Returns the command of a constant policy."""
    text = name.removeprefix(_CONSTANT)
    # Python also reads 0_1 and +1, but the name is part of an evaluation's id.
    if not _NUMBER.fullmatch(text) or not -1 <= float(text) <= 1:
        raise RequestError(
            f"{name}: a constant command lies in [-1, 1]; type constant:0.5, for example."
        )
    return float(text)


def find_trained_agent(results: Results, name: str) -> tuple[str, TrainedAgent]:
    """Returns the id of a run and its trained agent.

    Args:
        results: where the run is, unless it is a shipped one.
        name: the id of a run, or "reference/" and the id of a shipped run.

    Raises:
        RequestError: if there is no such run, or it has no policy.
        WorkError: if its files are damaged.
    """
    located, run = _locate(results, name)
    return run, load_agent(located, run)


def full_name(results: Results, name: str) -> str:
    """Completes the name of a trained policy to the whole id of its run.

    `reference/face_direction/ddpg/full` is short for the only shipped policy of these runs, and
    `face_direction/ddpg` for the only such run of the results.

    Raises:
        RequestError: if there is no such kind of policy, its command is wrong, no shipped policy
            matches the name, or several runs do.
    """
    if is_sb3_zip(name):
        return name
    if "/" in name:
        return f"{SHIPPED if name.startswith(SHIPPED) else ''}{_locate(results, name)[1]}"
    if name.startswith(_CONSTANT):
        _constant(name)
    if name.partition(":")[0] in POLICIES or is_imported_policy(name):
        return name
    raise _unknown(name)


def shipped_policies() -> list[str]:
    """Returns the names of all policies shipped with jbench."""
    runs = shipped_results().scan("run")[0]
    return sorted(f"{SHIPPED}{run.id}" for run in runs if has_policy(run))


def training_robots(results: Results, name: str) -> range:
    """Returns the seeds of the augmented robots that a policy was trained on.

    Raises:
        RequestError: if the name is an invalid run id or an unknown shipped policy.
        WorkError: if the run's manifest can't be read.
    """
    run = None if (record := _find_run(results, name)) is None else read_run(record.settings)
    if run is None or not isinstance(run.augment, int):
        return range(0)
    return range(run.augment, run.augment + run.robots)


def learned_task(results: Results, name: str) -> str | None:
    """Returns the task of a trained policy; None for other policies.

    Raises:
        RequestError: if the name is not a valid run id or shipped policy.
        WorkError: if the run's manifest can't be read.
    """
    record = _find_run(results, name)
    return None if record is None else read_run(record.settings).task


def _find_run(results: Results, name: str) -> Record | None:
    """Returns the run of a trained policy; None if there is none or the policy is not trained."""
    if "/" not in name or is_sb3_zip(name):
        return None
    located, run = _locate(results, name)
    return located.find("run", run)


def _locate(results: Results, name: str) -> tuple[Results, str]:
    """Returns the results directory and the id of a trained policy's run."""
    if name.startswith(SHIPPED):
        return shipped_results(), _shipped_run(name)
    return results, results.complete_id("run", name)


def _shipped_run(name: str) -> str:
    """Returns the run id of the shipped policy whose name is, or begins with, `name`."""
    names = shipped_policies()
    matches = [shipped for shipped in names if shipped.startswith(name)]
    if len(matches) == 1:
        return matches[0].removeprefix(SHIPPED)
    if matches:
        raise RequestError(
            f"{name} is not unique; type one of {', '.join(matches)} "
            "(jbench runs --results reference shows how they differ)."
        )
    close = get_close_matches(name, names, 3)
    choices = [shipped for shipped in names if shipped in close] or names
    instead = f"type one of {', '.join(choices)}" if names else "this version of jbench ships none"
    raise RequestError(f"No policy is shipped as {name}; {instead}.")


def _unknown(name: str) -> RequestError:
    close = closest(name, [*POLICIES, *installed_policies()])
    hint = f"did you mean {close}? Choose" if close else "choose"
    return RequestError(f"Unknown policy {name!r}; {hint} {POLICY_NAMES}.")
