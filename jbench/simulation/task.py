"""The interface of a task: what engine, datasets, encoders and evaluations know of a robot."""

import hashlib
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.closing import Closing
from jbench.settings.records import Specs

WorldsState = dict[str, NDArray[Any]]
"""What restores some worlds: arrays by name, each with a row per world."""


# Fields of MuJoCo's model and its options by which two robots differ; not drawn ones, and none that
# a later version might add.
_PHYSICAL = """
body_parentid body_pos body_quat body_mass body_inertia body_ipos jnt_type jnt_axis jnt_pos
jnt_range jnt_stiffness dof_damping dof_armature dof_frictionloss geom_type geom_size geom_pos
geom_quat geom_friction geom_contype geom_conaffinity site_pos tendon_stiffness tendon_damping
actuator_gear actuator_gainprm actuator_biasprm actuator_ctrlrange actuator_forcerange
"""
_OPTIONS = ("timestep", "gravity", "wind", "density", "viscosity", "integrator")


class Worlds(Closing):
    """Robots of one task in separate worlds, stepped together; their episodes begin together.

    A world's numbers depend neither on the other worlds nor on the number of threads. Use it as a
    context manager: it may hold threads.
    """

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


def model_hash(environment: Any) -> str | None:
    """Returns the SHA-256 of the physical parameters of an environment's MuJoCo model, if any.

    They are rounded to six digits, so that other versions of MuJoCo compile the same model.
    """
    model = getattr(getattr(environment, "physics", None), "model", None)
    if model is None:
        return None
    digest = hashlib.sha256()
    for holder, names in ((model, _PHYSICAL.split()), (model.opt, _OPTIONS)):
        for name in names:
            values = np.atleast_1d(np.asarray(getattr(holder, name), np.float64)) + 0.0
            text = " ".join(f"{value:.6g}" for value in values.ravel())
            digest.update(f"{name} {values.shape} {text}\n".encode())
    return digest.hexdigest()
