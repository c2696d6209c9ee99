"""The Jitterbug domain of the dm_control suite."""

from collections import OrderedDict
from typing import Any, TypedDict, Unpack

import numpy as np
from mujoco import MjModel

try:
    from dm_control import mujoco
    from dm_control.mujoco import wrapper
    from dm_control.rl import control
    from dm_control.suite import base
    from dm_control.utils import containers
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "The dm_control domains need dm-control, which pip can't install on Python 3.13 and later "
        "(labmaze has no wheel there); use Python 3.11 or 3.12, or the Gymnasium environments."
    ) from error

from jbench.names import CONTROL_TIMESTEP
from jbench.tasks import features, model, resets, rewards
from jbench.tasks.robots import load_model

# Length of an episode in seconds (paper, section 4.1).
_DEFAULT_TIME_LIMIT = 10

SUITE = containers.TaggedTasks()


class TaskSettings(TypedDict, total=False):
    """Settings of every task of the domain.

    Attributes:
        time_limit: simulated seconds in an episode (default 10).
        control_timestep: simulated seconds for which an action is held (default 0.01).
        random_pose: whether an episode starts in a random orientation (default) or in the rest
            pose.
        random: random state, its seed, or None for an arbitrary one.
        environment_kwargs: further arguments of dm_control's `Environment`.
    """

    time_limit: float
    control_timestep: float
    random_pose: bool
    random: np.random.RandomState | int | None
    environment_kwargs: dict[str, Any] | None


@SUITE.add("benchmarking", "easy")
def move_from_origin(**settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the task of moving away from the origin, in any direction."""
    return _environment("move_from_origin", **settings)


@SUITE.add("benchmarking", "easy")
def face_direction(**settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the task of turning to face in a random direction."""
    return _environment("face_direction", **settings)


@SUITE.add("benchmarking", "easy")
def move_in_direction(**settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the task of moving in a random direction."""
    return _environment("move_in_direction", **settings)


@SUITE.add("benchmarking", "hard")
def move_to_position(**settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the task of moving to a random position."""
    return _environment("move_to_position", **settings)


@SUITE.add("benchmarking", "hard")
def move_to_pose(**settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the task of moving to a random position and facing in a random direction."""
    return _environment("move_to_pose", **settings)


def _environment(task: str, **settings: Unpack[TaskSettings]) -> control.Environment:
    """Returns the environment of a task with the plain robot."""
    return environment(task, load_model(), **settings)


def environment(
    task: str,
    robot: MjModel,
    time_limit: float = _DEFAULT_TIME_LIMIT,
    control_timestep: float = CONTROL_TIMESTEP,
    random_pose: bool = True,
    random: np.random.RandomState | int | None = None,
    environment_kwargs: dict[str, Any] | None = None,
) -> control.Environment:
    """Returns the environment of a task for a robot; see `TaskSettings`."""
    settings = {"control_timestep": control_timestep, **(environment_kwargs or {})}
    return control.Environment(
        Physics.from_model(wrapper.MjModel(robot)),
        Jitterbug(task, random_pose=random_pose, random=random),
        time_limit=time_limit,
        **settings,
    )


class Physics(mujoco.Physics):
    """Physics of the Jitterbug with the quantities that its tasks use."""

    def robot_state(self) -> features.State:
        """Returns the robot's state as used by the tasks."""
        named = self.named.data
        return features.State(
            position=named.qpos["root"].copy(),
            velocity=named.qvel["root"].copy(),
            motor_position=features.motor_angle(named.qpos["motor"][0]),
            motor_velocity=named.qvel["motor"][0],
            torso_velocity=named.sensordata["torso_velocity"].copy(),
        )

    def target(self) -> features.Target:
        """Returns the target's position and yaw."""
        matrix = self.named.data.xmat["target"]
        return features.Target(
            position=self.named.data.xpos["target"].copy(),
            yaw=np.arctan2(matrix[3], matrix[0]),
        )

    def set_target(self, target: features.Target) -> None:
        """Moves the target."""
        self.named.model.body_pos["target"] = target.position
        self.named.model.body_quat["target"] = model.yaw_quaternion(target.yaw)


class Jitterbug(base.Task):
    """One of the five tasks of the Jitterbug problem (paper, section 4.2)."""

    def __init__(
        self,
        task: str,
        random_pose: bool = True,
        random: np.random.RandomState | int | None = None,
    ) -> None:
        """Initializes the task; see `TaskSettings`."""
        self._task = task
        self._random_pose = random_pose
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Places the robot at the origin and draws the target."""
        quaternion = resets.draw_quaternion(self.random) if self._random_pose else model.UPRIGHT
        physics.named.data.qpos["root"] = [0, 0, model.REST_HEIGHT, *quaternion]
        physics.set_target(resets.draw_target(self._task, self.random))
        # The reward, by which the robot may be colored, needs the new positions.
        physics.forward()
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> OrderedDict[str, np.ndarray]:
        """Returns the task's features, each mapped from its range to [-1, 1], by name."""
        observation = features.observation(self._task, physics.robot_state(), physics.target())
        return OrderedDict(features.split(self._task, observation))

    def get_reward(self, physics: Physics) -> float:
        """Returns the task's reward, in [0, 1]."""
        return float(rewards.reward(self._task, physics.robot_state(), physics.target()))
