"""Rollouts of a policy in several worlds."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.names import EPISODE_STEPS
from jbench.simulation.task import Worlds

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (worlds, action_size) for observations (worlds, dim(O))."""


class Transition(NamedTuple):
    """A control step of all worlds.

    Attributes:
        observations: (worlds, dim(O)) before the action, float32.
        actions: (worlds, action_size) of the policy.
        rewards: (worlds,) of the state after the action.
        next_observations: (worlds, dim(O)) of that state, float32.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.floating]
    rewards: NDArray[np.floating]
    next_observations: NDArray[np.float32]


def rollout(worlds: Worlds, observations: NDArray[np.float32], act: Act) -> Iterator[Transition]:
    """Yields the control steps of one episode in each world.

    Args:
        observations: that `worlds.reset` returned.
    """
    for _ in range(EPISODE_STEPS):
        actions = np.asarray(act(observations))
        next_observations, rewards = worlds.step(actions)
        yield Transition(observations, actions, rewards, next_observations)
        observations = next_observations
