"""The Jitterbug domain of the dm_control suite."""

import sys
from collections import OrderedDict
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

try:
    from dm_control import mujoco, suite
    from dm_control.mujoco import wrapper
    from dm_control.rl import control
    from dm_control.suite import base
    from dm_control.utils import containers
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "The dm_control domains need dm-control, which pip can't install on Python 3.13 and later "
        "(labmaze has no wheel there); use Python 3.11 or 3.12, or the Gymnasium environments."
    ) from error

from jbench.names import TASKS
from jbench.task_specs import CONTROL_TIMESTEP, EPISODE_STEPS
from jbench.tasks.jitterbug import features, geometry, model, resets, rewards
from jbench.tasks.jitterbug.robots import load_model

SUITE = containers.TaggedTasks()  # the domain `jitterbug`

AUGMENTED_SUITE = containers.TaggedTasks()
"""The domain `augmented_jitterbug`: robots of randomized morphology, by default that of seed 0."""


def environment(
    task: str,
    augment: int | None = None,
    vary_masses: bool = False,
    *,
    time_limit: float = EPISODE_STEPS * CONTROL_TIMESTEP,
    control_timestep: float = CONTROL_TIMESTEP,
    random_pose: bool = True,
    random: np.random.RandomState | int | None = None,
    environment_kwargs: dict[str, Any] | None = None,
) -> control.Environment:
    """Returns the environment of a task.

    Args:
        augment: seed of an augmented robot's morphology; None for the plain robot.
        vary_masses: whether to vary the augmented robot's densities and gear as well.
        time_limit: simulated seconds in an episode.
        control_timestep: simulated seconds for which an action is held.
        random_pose: whether an episode starts in a random orientation or in the rest pose.
        random: random state, its seed, or None for an arbitrary one.
        environment_kwargs: further arguments of dm_control's `Environment`.
    """
    robot = load_model(augment, vary_masses=vary_masses)
    settings = {"control_timestep": control_timestep, **(environment_kwargs or {})}
    return control.Environment(
        Physics.from_model(wrapper.MjModel(robot)),
        Jitterbug(task, random_pose=random_pose, random=random),
        time_limit=time_limit,
        **settings,
    )


# Results of different augmented robots are no benchmark.
for _task in TASKS:
    _plain = partial(environment, _task)
    _augmented = partial(environment, _task, augment=0)
    _plain.__name__ = _augmented.__name__ = _task  # type: ignore[attr-defined]
    SUITE.add("benchmarking", "hard" if _task.startswith("move_to") else "easy")(_plain)
    AUGMENTED_SUITE.add()(_augmented)


def add_to_suite() -> None:
    """Adds the domains `jitterbug` and `augmented_jitterbug` to dm_control's suite."""
    suite._DOMAINS["jitterbug"] = sys.modules[__name__]
    suite._DOMAINS["augmented_jitterbug"] = SimpleNamespace(SUITE=AUGMENTED_SUITE)
    suite.ALL_TASKS = suite._get_tasks(tag=None)
    suite.BENCHMARKING = suite._get_tasks("benchmarking")
    suite.EASY = suite._get_tasks("easy")
    suite.HARD = suite._get_tasks("hard")
    suite.EXTRA = tuple(sorted(set(suite.ALL_TASKS) - set(suite.BENCHMARKING)))
    suite.REWARD_VIZ = tuple(sorted(set(suite.ALL_TASKS) - set(suite.NO_REWARD_VIZ)))
    suite.TASKS_BY_DOMAIN = suite._get_tasks_by_domain(suite.ALL_TASKS)


class Physics(mujoco.Physics):
    """Physics of the Jitterbug with the quantities that its tasks use."""

    def robot_state(self) -> geometry.State:
        """Returns the robot's state as used by the tasks."""
        named = self.named.data
        return geometry.State(
            position=named.qpos["root"].copy(),
            velocity=named.qvel["root"].copy(),
            motor_position=geometry.motor_angle(named.qpos["motor"][0]),
            motor_velocity=named.qvel["motor"][0],
            torso_velocity=named.sensordata["torso_velocity"].copy(),
        )

    def target(self) -> geometry.Target:
        """Returns the target's position and yaw."""
        matrix = self.named.data.xmat["target"]
        return geometry.Target(
            position=self.named.data.xpos["target"].copy(), yaw=np.arctan2(matrix[3], matrix[0])
        )

    def set_target(self, target: geometry.Target) -> None:
        """Moves the target."""
        self.named.model.body_pos["target"] = target.position
        self.named.model.body_quat["target"] = model.yaw_quaternion(target.yaw)


class Jitterbug(base.Task):
    """One of the five tasks of the Jitterbug problem (paper, section 4.2)."""

    def __init__(
        self, task: str, random_pose: bool = True, random: np.random.RandomState | int | None = None
    ) -> None:
        """Has the name of the task, and whether poses are drawn."""
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
