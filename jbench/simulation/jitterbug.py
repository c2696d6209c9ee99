"""The five tasks of the Jitterbug behind the interface of all tasks."""

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench.names import CONTROL_TIMESTEP
from jbench.simulation.robots import Robots
from jbench.simulation.task import Task, Worlds, WorldsState
from jbench.task_specs import TASK_SPECS
from jbench.tasks import resets
from jbench.tasks.features import FEATURES, feature_labels, observation
from jbench.tasks.geometry import State, Target, heading
from jbench.tasks.rewards import reward, upright_reward
from jbench.tasks.robots import load_model

_robot_model = lru_cache(maxsize=2)(load_model)


class JitterbugTask(Task):
    """One of the five tasks."""

    action_size = 1
    control_timestep = CONTROL_TIMESTEP
    specs = None

    def __init__(self, name: str) -> None:
        self.name = name
        self.parts = {part: FEATURES[part].size for part in TASK_SPECS[name].features}

    @property
    def labels(self) -> list[str]:
        """A name for each value of an observation, such as `position_x`."""
        return feature_labels(self.name)

    def worlds(self, count: int, threads: int = 1, augment: int | None = None) -> "JitterbugWorlds":
        """Returns new worlds; see `Task.worlds`."""
        return JitterbugWorlds(self.name, _robot_model(augment), count, threads)


class JitterbugWorlds(Worlds):
    """Robots of one of the five tasks, with their state after the last step or reset."""

    robot_state: State
    target: Target

    def __init__(self, task: str, model: mujoco.MjModel, count: int, threads: int) -> None:
        self._task, self._robots = task, Robots(model, count, threads)
        self.target = Target(np.zeros((count, 3)), np.zeros(count))

    def reset(
        self, generators: Sequence[Generator], yaw: float | None = None
    ) -> NDArray[np.float32]:
        """Begins an episode in each world, with targets of a yaw (rad) or, if None, as drawn."""
        quaternions, self.target = resets.draw_starts(self._task, generators)
        if yaw is not None:
            self.target = self.target._replace(yaw=np.full(len(quaternions), yaw))
        return self._observe(self._robots.reset(quaternions))

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, 1); see `Worlds.step`."""
        state = self._robots.step(actions[:, 0])
        return self._observe(state), np.asarray(reward(self._task, state, self.target))

    def state(self, rows: slice) -> WorldsState:
        """Returns the complete state of some worlds, at any control step."""
        return {
            "simulation": self._robots.snapshot(rows),
            "target_position": self.target.position[rows].copy(),
            "target_yaw": self.target.yaw[rows].copy(),
        }

    def restore(self, rows: slice, state: WorldsState) -> NDArray[np.float32]:
        """Restores what `state` returned; the worlds then continue bit for bit."""
        self.target.position[rows] = state["target_position"]
        self.target.yaw[rows] = state["target_yaw"]
        return self._observe(self._robots.restore(state["simulation"], rows))

    def points(self) -> NDArray[np.float32]:
        """Returns x, y (m) and heading (rad) of each robot (worlds, 3)."""
        state = self.robot_state
        points = [state.position[:, 0], state.position[:, 1], heading(state)]
        return np.stack(points, axis=-1).astype(np.float32)

    def robot_columns(self) -> dict[str, NDArray[np.float32]]:
        """Returns the columns of `schema.POLICY_STATES` on the robots, each (worlds,)."""
        state = self.robot_state
        columns = {
            **dict(zip("xyz", state.position[:, :3].T, strict=True)),
            "heading": heading(state),
            "upright": upright_reward(state),
            "motor_position": state.motor_position,
            "motor_velocity": state.motor_velocity,
        }
        return {name: np.asarray(values, np.float32) for name, values in columns.items()}

    def targets(self) -> dict[str, NDArray[np.float64]]:
        """Returns x, y (m) and yaw (rad) of the targets, those that the task draws."""
        numbers = resets.target_numbers(self._task, self.target).T
        return dict(zip(TASK_SPECS[self._task].target, numbers, strict=True))

    def _observe(self, state: State) -> NDArray[np.float32]:
        self.robot_state = state
        return np.asarray(observation(self._task, state, self.target), np.float32)
