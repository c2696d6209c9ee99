"""The base class of tasks: what engine, datasets, encoders and evaluations know of a robot.

Also rollouts of a policy in several worlds, and the path of a robot in an episode.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.arrays import Array
from jbench.settings.specs import Specs
from jbench.tasks.worlds import Worlds
from jbench.wording import counted

Act = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Returns actions (worlds, action_size) for observations (worlds, dim(O))."""

PATH_EVERY = 20
"""Control steps between two points of a path: 0.2 s, in which the hand-written policies move up to
6 cm, the distance between two feet. A whole episode has 51 points."""


class HandWritten(Protocol):
    """A hand-written policy."""

    def reset(self, robots: int) -> None:
        """Begins an episode of some robots."""

    def act(self, observation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Returns actions (robots, action_size) in [-1, 1] for observations (robots, dim(O))."""


class Task(ABC):
    """Base class of tasks, which have a time limit and actions in [-1, 1].

    A subclass sets the attributes that have no default, and makes `worlds`. The other answers are
    those of a robot that jbench sees for the first time: unknown, or no.

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
        has_physics: whether its worlds have MuJoCo's model and data; others draw themselves.
        has_one_model: whether all episodes of a world have the same model of MuJoCo.
        render_fps: pictures per second, one for each control step, that its environment names;
            None if it names none.
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
    has_physics: bool = True
    has_one_model: bool = False
    render_fps: float | None = None

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

    def observed(self, physical: Array) -> Array:
        """Returns the observations (..., dim(O)) of values in their units, numpy or torch."""
        return physical

    def mirror(self) -> Array | None:
        """Returns the factors (dim(O),), 1 or -1, of an observation's values in a mirror image.

        None if no mirror image of the robot is known; the action is negated in it.
        """
        return None

    def goal(self, observation: NDArray[np.floating]) -> str:
        """Describes in words what is left to the goal of an observation (dim(O),)."""
        return ""

    @property
    def robot(self) -> str:
        """Name of the robot of its datasets, which other tasks may share."""
        return self.name

    @property
    def shown_timestep(self) -> float | None:
        """Seconds of a control step in a video: those simulated, or else those of its pictures."""
        if self.control_timestep or not self.render_fps:
            return self.control_timestep
        return 1 / self.render_fps

    @property
    def length_in_words(self) -> str:
        """How long an episode is, such as "at most 500 control steps"."""
        length = counted(self.episode_steps, "control step")
        return f"at most {length}" if self.ends_early else length

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

    @property
    def action_bounds(self) -> NDArray[np.float64]:
        """What the actions -1 and 1 are for each actuator, (2, action_size)."""
        return np.array([[-1.0], [1.0]]).repeat(self.action_size, axis=1)

    @abstractmethod
    def worlds(
        self,
        count: int,
        threads: int = 1,
        augment: int | None = None,
        *,
        vary_masses: bool = False,
    ) -> Worlds:
        """Returns new worlds, before their first episode, stepped by `threads` with the caller's.

        A task may have augmented robots, which have a seed, and whose masses may vary as well.
        """

    def world(self, augment: int | None = None, *, vary_masses: bool = False) -> Worlds:
        """Returns one world, whose `physics` its owner may read and change between two steps."""
        return self.worlds(1, augment=augment, vary_masses=vary_masses)


def episode_generator(seed: int, episode: int) -> Generator:
    """Returns the generator of one episode, independent of the other episodes."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(episode,)))


DOES_NOT_REPEAT = (
    "the same seed and actions made another episode, so its runs can't be reproduced; one that is "
    "resumed truncates the episodes that it can't repeat"
)
"""What users should know of a task that does not repeat, as a clause."""


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


class RobotPath(NamedTuple):
    """Path of a robot in an episode."""

    points: NDArray[np.float32]  # (n, 3) x, y (m), heading (rad) every `PATH_EVERY` steps
    target: dict[str, float]  # its random numbers: "x" and "y" (m), "yaw" (rad), or some of them
