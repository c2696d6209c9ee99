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

from jbench.errors import WorkError
from jbench.settings.records import Specs

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (worlds, action_size) for observations (worlds, dim(O))."""

PATH_EVERY = 20
"""Control steps between two points of a path: 0.2 s, in which the hand-written policies move up to
6 cm, the distance between two feet. A whole episode has 51 points."""

WorldsState = dict[str, NDArray[Any]]
"""What restores some worlds: arrays by name, each with a row per world."""


class EpisodeError(WorkError):
    """An episode that can't go on: its environment raised an error, or returned no finite numbers.

    The same seed and actions make the same error, so repeating the work is of no use.
    """

    def __init__(self, task: str, seed: int, step: int, reason: str) -> None:
        """Names the seed of the episode, and its control step, 0 before the first action."""
        self.summary = {"episode_failed": {"task": task, "seed": seed, "step": step}}
        self._arguments = task, seed, step, reason
        super().__init__(
            f"jbench can't use the task {task}: at control step {step} of the episode with seed "
            f"{seed}, {reason}."
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Makes it again in another process, from its arguments."""
        return EpisodeError, self._arguments


class Worlds(AbstractContextManager["Worlds"]):
    """Robots of one task in separate worlds, stepped together; `reset` begins their episodes.

    A world's numbers depend neither on the other worlds nor on the number of threads. Use it as a
    context manager: it may hold threads.

    Attributes:
        episode_steps: control steps of an episode.
        failures: errors of the episodes that can't go on, by world. Such a world is no longer
            stepped: it has its last observation and rewards of 0.
    """

    episode_steps: int
    failures: dict[int, EpisodeError]

    def check(self) -> None:
        """Raises the error of the first world that failed, if there is one."""
        for error in self.failures.values():
            raise error

    def __exit__(self, *_: object) -> None:
        """Closes the worlds."""
        self.close()

    def close(self) -> None:
        """Releases what the worlds hold: nothing by default, since threads end with the object."""

    @abstractmethod
    def reset(
        self, generators: Sequence[Generator], yaw: float | None = None
    ) -> NDArray[np.float32]:
        """Begins an episode in each world and returns the observations (worlds, size).

        All random numbers of a world are drawn from its generator, which others may share. `yaw`
        (rad) is that of all targets, if the task records states; None for drawn ones.
        """

    @abstractmethod
    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, action_size), clipped to [-1, 1], for one control step.

        Returns the observations (worlds, size), a new array, and the rewards (worlds,).
        """

    def are_over(self) -> bool:
        """Returns whether the episodes of all worlds have ended before `episode_steps`."""
        return False

    def lengths(self) -> NDArray[np.int64] | int:
        """Returns the control steps of the episodes that have ended, (worlds,) if they differ."""
        return self.episode_steps

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

    def whole_targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns x, y (m) and yaw (rad) of the targets by name, also those that are not drawn."""
        return {}

    def robot_columns(self) -> dict[str, NDArray[np.float32]]:
        """Returns the columns of `policy_states` on the robots, each (worlds,), if any."""
        return {}


class EndingWorlds(Worlds):
    """Worlds whose episodes end on their own, each at its own control step.

    A world whose episode has ended is not stepped until the next one begins: it has its last
    observation and rewards of 0.

    Attributes:
        elapsed: (worlds,) control steps of the current episodes.
        terminated: (worlds,) whether nothing follows the last state of an episode.
        truncated: (worlds,) whether an episode has ended, but its last state was not terminal.
        unlike: worlds whose episodes `restore` could not repeat with the same observation.
    """

    elapsed: NDArray[np.int64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    unlike: set[int]

    @abstractmethod
    def begin(self, worlds: Sequence[int], generators: Sequence[Generator]) -> NDArray[np.float32]:
        """Begins an episode in some worlds, each with its generator; see `reset`.

        Returns the observations (worlds, size) of all worlds.
        """


class HandWritten(Protocol):
    """A hand-written policy."""

    def reset(self, robots: int) -> None:
        """Begins an episode of some robots."""

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Returns actions (robots, action_size) in [-1, 1] for observations (robots, dim(O))."""


class Task(Protocol):
    """A task with a time limit and actions in [-1, 1].

    What a task does not answer differently is unknown, as of a robot that jbench sees first.

    Attributes:
        parts: number of values of each part of the observation, in order, by name.
        control_timestep: simulated seconds in a control step; None if unknown.
        episode_steps: control steps of an episode, after which it is truncated.
        ends_early: whether an episode may end before; then its worlds are `EndingWorlds`.
        specs: what settings record of the task besides its name; None for those of the Jitterbug.
        notes: what users should know of it, in a sentence each, without a full stop.
        description: the first line of the docstring of a user's task.
        units: SI unit of each value of an observation, 1 for none; None if they are unknown.
        observed_range: least and largest value of each, in its unit, which are -1 and 1 in an
            observation; None if observations are as the robot has them.
        drawn: names of the target's random numbers.
        cameras: names of the cameras; None if only the model has them.
        default_camera: the one that films if users name none.
        scale: what gives pictures a scale, such as the size of a check of the floor.
        has_state_within_episode: whether a run can be resumed within an episode.
        has_planar_reduction: whether it moves on a floor, and its heading frame is known to the
            kinds of encoders that are called planar.
        records_states: whether an evaluation can record states and choose targets.
    """

    name: str
    parts: Mapping[str, int]
    action_size: int
    control_timestep: float | None
    episode_steps: int
    specs: Specs | None
    ends_early: bool = False
    notes: tuple[str, ...] = ()
    description: str = ""
    units: Sequence[str] | None = None
    observed_range: tuple[Sequence[float], Sequence[float]] | None = None
    drawn: tuple[str, ...] = ()
    cameras: tuple[str, ...] | None = None
    default_camera: str | None = None
    scale: str = ""
    has_state_within_episode: bool = False
    has_planar_reduction: bool = False
    records_states: bool = False

    def hand_written(self) -> HandWritten | None:
        """Returns a new hand-written policy, if there is one."""
        return None

    def code_provenance(self) -> dict[str, Any]:
        """Returns provenance of its code, and the checksum of its robot, if it is a user's.

        Of an environment of an installed library it is the version of its package.
        """
        return {}

    def repeats(self) -> bool:
        """Returns whether the same seed and actions make the same episode, as far as was tried."""
        return True

    def physical(self, observations: NDArray[np.floating]) -> NDArray[np.floating]:
        """Returns observations (..., dim(O)) in their units."""
        return observations

    def goal(self, observation: NDArray[np.floating]) -> str:
        """Describes in words what is left to the goal of an observation (dim(O),)."""
        return ""

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
    """Yields the control steps of an episode in each world, from what `worlds.reset` returned.

    It ends with the longest of them.
    """
    for _ in range(worlds.episode_steps):
        if worlds.are_over():
            return
        actions = np.asarray(act(observations))
        next_observations, rewards = worlds.step(actions)
        yield ControlStep(observations, actions, rewards, next_observations)
        observations = next_observations


class Path(NamedTuple):
    """Path of a robot in an episode."""

    points: NDArray[np.float32]  # (n, 3) x, y (m), heading (rad) every `PATH_EVERY` steps
    target: dict[str, float]  # its random numbers: "x" and "y" (m), "yaw" (rad), or some of them
