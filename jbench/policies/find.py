"""Any policy by the name that a user types: random, constant, hand-written or trained."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jbench.errors import RequestError
from jbench.policies.saved import has_policy, load_agent
from jbench.settings.run import read_run
from jbench.store import Record, Results
from jbench.store.shipped import shipped
from jbench.tasks.heuristics import heuristic

SHIPPED = "reference/"
"""What the name of a shipped policy begins with; the id of its run follows."""

KINDS = (
    "heuristic, random, constant:U with U in [-1, 1], the id of a run, or "
    f"{SHIPPED} and the id of a run that is shipped with jbench"
)


class ActingPolicy(Protocol):
    """A policy for any number of robots at a time, on the plain observations of its task."""

    def reset(self, robots: int) -> None:
        """Begins new episodes of so many robots."""

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        """Returns actions (robots, 1) in [-1, 1] for observations (robots, dim(O))."""


class _Random:
    """Uniform actions, as the random-policy dataset has them."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(np.random.SeedSequence(seed))

    def reset(self, robots: int) -> None:
        pass

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        return self._random.uniform(-1, 1, (len(observations), 1))


class _Constant:
    """One motor command for ever."""

    def __init__(self, command: float) -> None:
        self._command = command

    def reset(self, robots: int) -> None:
        pass

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.floating]:
        return np.full((len(observations), 1), self._command)


class _Trained:
    """The agent of a finished run."""

    def __init__(self, results: Results, run: str, task: str) -> None:
        agent = load_agent(results, run)
        if agent.task != task:
            raise RequestError(
                f"The run {run} learned {agent.task}, not {task}; type --task {agent.task}."
            )
        self.act = agent.act

    def reset(self, robots: int) -> None:
        pass


def find_policy(results: Results, name: str, task: str, seed: int = 0) -> ActingPolicy:
    """Returns the policy that a user means.

    Args:
        results: where runs are.
        name: "heuristic", "random", "constant:U", a run's id, or that of a shipped run after
            "reference/".
        task: the task of the robots that the policy moves.
        seed: of the random policy.

    Raises:
        RequestError: if there is no such policy, or it is one for another task.
    """
    if name == "heuristic":
        return heuristic(task)
    if name == "random":
        return _Random(seed)
    kind, colon, text = name.partition(":")
    if kind == "constant" and colon:
        try:
            command = float(text)
        except ValueError:
            command = np.nan
        if not -1 <= command <= 1:
            raise RequestError(f"--policy {name}: a constant command lies in [-1, 1].")
        return _Constant(command)
    if "/" not in name:
        raise RequestError(f"Unknown policy {name!r}; choose {KINDS}.")
    return _Trained(*_locate(results, name), task)


def full_name(name: str) -> str:
    """Returns the name of a policy with the whole id of its run, if it is a shipped one.

    `reference/face_direction/ddpg/full` stands for the one policy that is shipped of these runs.

    Raises:
        RequestError: if none is shipped of that name, or several are.
    """
    return f"{SHIPPED}{_shipped_run(name)}" if name.startswith(SHIPPED) else name


def shipped_policies() -> list[str]:
    """Returns the names of all policies that are shipped with jbench."""
    runs = Results(shipped()).scan("run")[0]
    return sorted(f"{SHIPPED}{run.id}" for run in runs if has_policy(run))


def robots_learned_on(results: Results, name: str) -> range:
    """Returns the seeds of the augmented robots that a trained agent learned on, in turn.

    Args:
        results: where runs are.
        name: of a policy; only trained ones have learned on any.

    Raises:
        RequestError: if it looks like a run's id and can't be one, or is no shipped policy.
        WorkError: if the run's manifest can't be read.
    """
    run = None if (record := _find_run(results, name)) is None else read_run(record.settings)
    if run is None or not isinstance(run.augment, int):
        return range(0)
    return range(run.augment, run.augment + run.robots)


def _find_run(results: Results, name: str) -> Record | None:
    """Returns the run of a trained policy, or None if there is none or the policy is no run's."""
    if "/" not in name:
        return None
    place, run = _locate(results, name)
    return place.find("run", run)


def _locate(results: Results, name: str) -> tuple[Results, str]:
    """Returns the results that hold the run of a trained policy, and the run's id."""
    if name.startswith(SHIPPED):
        return Results(shipped()), _shipped_run(name)
    return results, name


def _shipped_run(name: str) -> str:
    """Returns the id of the run whose policy is shipped under a name, or the start of one."""
    there = shipped_policies()
    found = [one for one in there if one == name or one.startswith(f"{name.rstrip('/')}/")]
    if len(found) == 1:
        return found[0].removeprefix(SHIPPED)
    if found:
        raise RequestError(f"--policy {name} is not unique; type one of {', '.join(found)}.")
    instead = f"type one of {', '.join(there)}" if there else "this version of jbench ships none"
    raise RequestError(f"No policy is shipped as {name}; {instead}.")
