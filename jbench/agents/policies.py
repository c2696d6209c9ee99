"""Any policy by the name that a user types: random, constant, hand-written or trained."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from jbench.agents.policy import load_agent
from jbench.errors import RequestError
from jbench.store import Results
from jbench.tasks.heuristics import heuristic

KINDS = "heuristic, random, constant:U with U in [-1, 1], or the id of a run"


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
        name: "heuristic", "random", "constant:U", or a run's id.
        task: that the policy shall do.
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
        raise RequestError(f"No policy {name!r}; there are {KINDS}.")
    return _Trained(results, name, task)


def robots_learned_on(results: Results, name: str) -> range:
    """Returns the seeds of the augmented robots that a trained agent learned on, in turn.

    Args:
        results: where runs are.
        name: of a policy; no other than a run's id has learned on any.

    Raises:
        RequestError: if it looks like a run's id and can't be one.
        WorkError: if the run's manifest can't be read.
    """
    record = results.find("run", name) if "/" in name else None
    settings = {} if record is None else record.settings
    first, robots = settings.get("augment"), settings.get("robots", 1)
    if not isinstance(first, int) or not isinstance(robots, int):
        return range(0)
    return range(first, first + robots)
