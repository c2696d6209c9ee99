"""Worlds of the Jitterbug: its observations, rewards and targets over its simulation."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from jbench import task_specs
from jbench.arrays import Array
from jbench.task_specs import TASK_SPECS
from jbench.tasks.jitterbug import resets
from jbench.tasks.jitterbug.features import features, flatten
from jbench.tasks.jitterbug.geometry import State, Target, distance_to_target, heading
from jbench.tasks.jitterbug.model import yaw_quaternion
from jbench.tasks.jitterbug.rewards import reward_terms, upright_reward
from jbench.tasks.jitterbug.simulation import OneRobot, Robots
from jbench.tasks.worlds import Chosen, ModelAndData, Worlds, WorldsState


class JitterbugWorlds(Worlds):
    """Robots of one of the five tasks, with their state after the last step or reset.

    Attributes:
        target: of each world, with the leading axis (worlds,).
    """

    target: Target
    # Of all robots; the leading axis is that of `Robots`, or none for `OneRobot`.
    _state: State
    _target: Target
    _seen: dict[str, Array]
    _terms: dict[str, Array]

    def __init__(self, task: str, robots: Robots | OneRobot) -> None:
        """Has no episode yet; see `reset`."""
        self._task = task
        self._robots = robots
        self.episode_steps = task_specs.EPISODE_STEPS
        self.failures = {}
        # The Jitterbug's episodes have no other end than their time limit.
        self.terminated = np.zeros(robots.count, bool)
        self.truncated = np.zeros(robots.count, bool)
        self.target = Target(np.zeros((robots.count, 3)), np.zeros(robots.count))

    def begin(
        self,
        worlds: Sequence[int],
        generators: Sequence[Generator],
        chosen: Chosen | None = None,
    ) -> NDArray[np.float32]:
        """Begins an episode in some worlds; `chosen` may have parts of `Target`, by name."""
        rows = list(worlds)
        quaternions, drawn = resets.draw_starts(self._task, generators)
        parts = {name: part.copy() for name, part in self.target._asdict().items()}
        for name, part in drawn._asdict().items():
            parts[name][rows] = part
        for name, part in (chosen or {}).items():
            parts[name][rows] = part[rows]

        self.target = Target(**parts)
        return self._begun(self._robots.reset(quaternions, rows))

    def read_options(self, options: Mapping[str, Any]) -> Chosen:
        """Returns the targets that {"target": numbers} chooses; see `resets.option_target`."""
        chosen = resets.option_target(self._task, options, self._robots.count)
        return {} if chosen is None else chosen._asdict()

    def step(
        self, actions: NDArray[np.floating]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Applies actions (worlds, 1); see `Worlds.step`."""
        state = self._robots.step(actions[:, 0])
        observations = self._observe(state)
        self._terms = reward_terms(self._task, state, self._target, self._seen)
        return observations, self._by_world(math.prod(self._terms.values()))

    def info(self) -> dict[str, NDArray[np.float64]]:
        """Returns the entries of `info`, see `describe`; after a reset, of the initial states."""
        if not self._terms:
            self._terms = reward_terms(self._task, self._state, self._target, self._seen)
        info = describe(self._task, self._state, self._target, self._seen, self._terms)
        return {name: self._by_world(value) for name, value in info.items()}

    @property
    def robot_state(self) -> State:
        """The state of the robots, with the leading axis (worlds,)."""
        return State(*(part if part is None else self._by_world(part) for part in self._state))

    def physics(self, world: int) -> ModelAndData:
        """Returns the robot of a world and its state, with the target where it is."""
        physics = self._robots.physics(world)
        target = physics.model.body("target")
        target.pos = self.target.position[world]
        target.quat = yaw_quaternion(self.target.yaw[world])
        return physics

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
        return self._begun(self._robots.restore(state["simulation"], rows))

    def points(self) -> NDArray[np.float32]:
        """Returns x, y (m) and heading (rad) of each robot (worlds, 3)."""
        state = self.robot_state
        points = [state.position[:, 0], state.position[:, 1], heading(state)]
        return np.stack(points, axis=-1).astype(np.float32)

    def robot_columns(self) -> dict[str, NDArray[np.float32]]:
        """Returns the columns of `policy_states` on the robots, each (worlds,)."""
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
        """Returns x, y (m) and yaw (rad) of the targets; see `Worlds.targets`."""
        position, yaw = self.target
        return {"x": position[:, 0], "y": position[:, 1], "yaw": yaw}

    def _begun(self, state: State) -> NDArray[np.float32]:
        """Returns the observations of a new state of the robots and of new targets."""
        position, yaw = self.target
        axes = self._robots.axes
        self._target = Target(position.reshape(*axes, 3), yaw.reshape(axes)[()])
        self.has_begun = True
        self._terms = {}
        return self._observe(state)

    def _observe(self, state: State) -> NDArray[np.float32]:
        """Returns the observations (worlds, size) of a new state of the robots."""
        self._state = state
        self._seen = features(self._task, state, self._target)
        return self._by_world(np.asarray(flatten(self._task, self._seen), np.float32))

    def _by_world(self, values: Array) -> NDArray[Any]:
        """Returns values of the robots, which may lack a leading axis, with that of the worlds."""
        return np.asarray(values if self._robots.axes else values[None])


class JitterbugWorld(JitterbugWorlds):
    """One robot, whose MuJoCo data its owner may read and change."""

    def __init__(self, task: str, model: mujoco.MjModel) -> None:
        """The model is stepped itself."""
        super().__init__(task, OneRobot(model, has_speed=TASK_SPECS[task].has_speed))

    def begin(
        self,
        worlds: Sequence[int],
        generators: Sequence[Generator],
        chosen: Chosen | None = None,
    ) -> NDArray[np.float32]:
        """See `JitterbugWorlds.begin`; a window that shows the model shows the new target."""
        observations = super().begin(worlds, generators, chosen)
        self.physics(0)
        return observations


def describe(
    task: str,
    state: State,
    target: Target,
    seen: Mapping[str, Array],
    terms: Mapping[str, Array],
) -> dict[str, Array]:
    """Returns the entries of `info` for states of a task, with any leading axes `...`.

    Args:
        task: one of the five tasks.
        state: of robots.
        target: of theirs.
        seen: the features of these states, see `features.features`.
        terms: of their rewards, see `rewards.reward_terms`.

    Returns:
        By name
            target: (..., n) the target's random numbers, see `resets.target_numbers`,
            distance: (...) from the torso to the target (m), if the reward depends on it,
            angle: (...) from heading to target in (-pi, pi] (rad), if the task observes it,
            reward_...: (...) each term of the reward, which is their product.
    """
    info = {}
    if TASK_SPECS[task].drawn:
        info["target"] = resets.target_numbers(task, target)
    if not {"near", "away"}.isdisjoint(TASK_SPECS[task].rewards):
        info["distance"] = distance_to_target(state, target)
    if "angle_to_target" in seen:
        info["angle"] = np.array(seen["angle_to_target"][..., 0])

    for name, term in terms.items():
        info[f"reward_{name}"] = np.array(term)
    return info
