"""Rollouts of a policy in several worlds, and the path of a robot in an episode."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.names import EPISODE_STEPS
from jbench.simulation.task import Worlds

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (worlds, action_size) for observations (worlds, dim(O))."""

PATH_EVERY = 20
"""Control steps between two points of a path: 0.2 s, in which the hand-written policies move up to
6 cm, the distance between two feet. A whole episode has 51 points."""


class ControlStep(NamedTuple):
    """A control step of all worlds."""

    observations: NDArray[np.float32]  # (worlds, dim(O)) before the action, float32
    actions: NDArray[np.floating]  # (worlds, action_size) of the policy
    rewards: NDArray[np.floating]  # (worlds,) of the state after the action
    next_observations: NDArray[np.float32]  # (worlds, dim(O)) of that state, float32


def rollout(worlds: Worlds, observations: NDArray[np.float32], act: Act) -> Iterator[ControlStep]:
    """Yields the control steps of an episode in each world, from what `worlds.reset` returned."""
    for _ in range(EPISODE_STEPS):
        actions = np.asarray(act(observations))
        next_observations, rewards = worlds.step(actions)
        yield ControlStep(observations, actions, rewards, next_observations)
        observations = next_observations


class Path(NamedTuple):
    """Path of a robot in an episode."""

    points: NDArray[np.float32]  # (n, 3) x, y (m), heading (rad) every `PATH_EVERY` steps
    target: dict[str, float]  # its random numbers: "x" and "y" (m), "yaw" (rad), or some of them
