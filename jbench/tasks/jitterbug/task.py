"""The Jitterbug's tasks behind the interface of all tasks."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from jbench import task_specs
from jbench.arrays import Array
from jbench.settings.records import JITTERBUG
from jbench.task_specs import CAMERAS, CONTROL_TIMESTEP, TASK_SPECS
from jbench.tasks.jitterbug import features
from jbench.tasks.jitterbug.control_laws import Law
from jbench.tasks.jitterbug.heuristics import LAWS
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots
from jbench.tasks.jitterbug.worlds import JitterbugWorld, JitterbugWorlds
from jbench.tasks.task import Task

_robot_model = lru_cache(maxsize=2)(load_model)


class JitterbugTask(Task):
    """One of the five tasks."""

    action_size = 1
    control_timestep = CONTROL_TIMESTEP
    specs = None
    cameras = CAMERAS
    default_camera = "tracking"
    scale = "1 check = 1 cm"
    robot = JITTERBUG
    has_state_within_episode = True
    has_planar_reduction = True
    records_states = True
    has_one_model = True

    def __init__(self, name: str) -> None:
        """Reads the sizes, units and ranges of a task from its row of `TASK_SPECS`."""
        self.name = name
        self.drawn = TASK_SPECS[name].drawn
        self.parts = {part: features.FEATURES[part].size for part in TASK_SPECS[name].features}
        self.units = features.by_dimension(name, "units")
        self.observed_range = (
            features.by_dimension(name, "low"),
            features.by_dimension(name, "high"),
        )

    @property
    def episode_steps(self) -> int:  # type: ignore[override]
        """Control steps of an episode."""
        return task_specs.EPISODE_STEPS

    @property
    def labels(self) -> list[str]:
        """A name for each value of an observation, such as `position_x`."""
        names = ((part, axis) for part in self.parts for axis in features.FEATURES[part].axes)
        return [f"{part}_{axis}" if axis else part for part, axis in names]

    def worlds(
        self,
        count: int,
        threads: int = 1,
        augment: int | None = None,
        *,
        vary_masses: bool = False,
    ) -> JitterbugWorlds:
        """Returns new worlds; see `Task.worlds`."""
        model = _robot_model(augment, vary_masses=vary_masses)
        robots = Robots(model, count, threads, has_speed=TASK_SPECS[self.name].has_speed)
        return JitterbugWorlds(self.name, robots)

    def world(self, augment: int | None = None, *, vary_masses: bool = False) -> JitterbugWorld:
        """Returns one world, with a model of its own; see `Task.world`."""
        return JitterbugWorld(self.name, load_model(augment, vary_masses=vary_masses))

    def hand_written(self) -> Law | None:
        """Returns a new hand-written policy with its tuned constants, if the task has one."""
        law = LAWS.get(self.name)
        return None if law is None else law()

    def physical(self, observations: NDArray[np.floating]) -> NDArray[np.floating]:
        """Returns observations (..., dim(O)) in their units."""
        physical: NDArray[np.floating] = features.denormalize(self.name, observations)
        return physical

    def observed(self, physical: Array) -> Array:
        """Returns the observations (..., dim(O)) of features in SI units, numpy or torch."""
        return features.normalize(self.name, physical)

    def mirror(self) -> Array:
        """Returns the factors (dim(O),) of an observation's features; see `features.mirrored`."""
        return np.array(features.by_dimension(self.name, "mirror"), np.float64)

    def goal(self, observation: NDArray[np.floating]) -> str:
        """Describes distance and direction of the target of an observation (dim(O),)."""
        return features.goal(self.name, observation)
