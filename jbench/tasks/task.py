"""The interface of a task: what engine, datasets, encoders and evaluations know of a robot.

Also rollouts of a policy in several worlds, and the path of a robot in an episode.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.names import EPISODE_STEPS
from jbench.settings.records import Specs

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (worlds, action_size) for observations (worlds, dim(O))."""

PATH_EVERY = 20
"""Control steps between two points of a path: 0.2 s, in which the hand-written policies move up to
6 cm, the distance between two feet. A whole episode has 51 points."""

WorldsState = dict[str, NDArray[Any]]
"""What restores some worlds: arrays by name, each with a row per world."""


class Worlds(AbstractContextManager["Worlds"]):
    """Robots of one task in separate worlds, stepped together; their episodes begin together.

    A world's numbers depend neither on the other worlds nor on the number of threads. Use it as a
    context manager: it may hold threads.
    """

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Releases what the worlds hold: nothing by default, since threads end with the object."""

    @abstractmethod
    def reset(self, generators: Sequence[Generator]) -> NDArray[np.float32]:
        """Begins an episode in each world and returns the observations (worlds, size).

        All random numbers of a world are drawn from its generator, which others may share.
        """

    @abstractmethod
    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, action_size), clipped to [-1, 1], for one control step.

        Returns the observations (worlds, size), a new array, and the rewards (worlds,) in [0, 1].
        """

    @abstractmethod
    def state(self, rows: slice) -> WorldsState:
        """Returns what `restore` needs of some worlds; within an episode, it may be a WorkError."""

    @abstractmethod
    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Restores what `state` returned; returns the observations (worlds, size) of all worlds."""

    def points(self) -> NDArray[np.float32] | None:
        """Returns x, y (m) and heading (rad) of each robot (worlds, 3), if the task has them."""
        return None

    def targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns the random numbers of the targets by name, each (worlds,)."""
        return {}


class Task(Protocol):
    """A task with episodes of 1000 control steps, rewards in [0, 1] and actions in [-1, 1].

    Attributes:
        parts: number of values of each part of the observation, in order, by name.
        control_timestep: simulated seconds in a control step; None if unknown.
        specs: what settings record of the task besides its name; None for those of the Jitterbug.
    """

    name: str
    parts: Mapping[str, int]
    action_size: int
    control_timestep: float | None
    specs: Specs | None

    @property
    def observation_size(self) -> int:
        """Number of values of an observation, the paper's dim(O)."""
        return sum(self.parts.values())

    @property
    def labels(self) -> list[str]:
        """A name for each value of an observation, such as `velocity_3`."""
        return [
            name if size == 1 else f"{name}_{i}"
            for name, size in self.parts.items()
            for i in range(size)
        ]

    @property
    def action_labels(self) -> list[str]:
        """A name for each value of an action, such as `action_0`."""
        return [f"action_{i}" for i in range(self.action_size)]

    @abstractmethod
    def worlds(self, count: int, threads: int = 1, augment: int | None = None) -> Worlds:
        """Returns new worlds, before their first episode, stepped by `threads` with the caller's.

        A task may have augmented robots, which have a seed.
        """


def episode_generator(seed: int, episode: int) -> Generator:
    """Returns the generator of one episode, independent of the other episodes."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(episode,)))


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
