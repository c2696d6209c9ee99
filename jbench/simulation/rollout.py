"""Rollouts of a policy on many robots."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.names import EPISODE_STEPS
from jbench.simulation.robots import Robots
from jbench.tasks import features
from jbench.tasks.features import State
from jbench.tasks.resets import Starts
from jbench.tasks.rewards import reward

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (robots, 1) for observations (robots, dim(O))."""


class Transition(NamedTuple):
    """A control step of all robots.

    Attributes:
        observations: (robots, dim(O)) before the action, float32.
        actions: (robots,) of the policy.
        state: after the action.
        rewards: (robots,) of that state.
        next_observations: (robots, dim(O)) of that state, float32.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.floating]
    state: State
    rewards: NDArray[np.floating]
    next_observations: NDArray[np.float32]


def rollout(task: str, robots: Robots, starts: Starts, act: Act) -> Iterator[Transition]:
    """Yields the control steps of one episode per robot.

    Args:
        robots: as many as `starts` has episodes; they are reset.
    """

    def observe(state: State) -> NDArray[np.float32]:
        return np.asarray(features.observation(task, state, starts.targets), np.float32)

    observations = observe(robots.reset(starts.quaternions))
    for _ in range(EPISODE_STEPS):
        actions = np.asarray(act(observations))[:, 0]
        state = robots.step(actions)
        rewards = np.asarray(reward(task, state, starts.targets))
        next_observations = observe(state)
        yield Transition(observations, actions, state, rewards, next_observations)
        observations = next_observations
