"""Tests of the content of datasets: actions, states and targets, against the simulation."""

import math

import mujoco
import numpy as np
import pytest
from scipy import stats

from jbench.names import TASKS
from jbench.tasks.gym import RobotEnv
from jbench.tasks.jitterbug import model as robot
from jbench.tasks.jitterbug.resets import draw_quaternion, draw_target, target_numbers
from jbench.tasks.jitterbug.robots import load_model

SIZES = dict(zip(TASKS, (15, 16, 19, 18, 19), strict=True))
COLUMNS = (
    *("position_x", "position_y", "position_z"),
    *("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"),
    *("velocity_x", "velocity_y", "velocity_z"),
    *("angular_velocity_x", "angular_velocity_y", "angular_velocity_z"),
    *("motor_position", "motor_velocity"),
)
COMPARED = 400
"""Control steps of an episode that are compared with each task's environment."""
EVERY_TASK = pytest.mark.parametrize("task", TASKS)


@pytest.fixture(scope="module")
def steps(six_episodes):
    """All states and actions, (episodes, steps + 1) by column."""
    rows = six_episodes.read("steps")
    columns = {name: rows[name].to_numpy(zero_copy_only=False) for name in rows.column_names}
    return {name: column.reshape(6, 1001) for name, column in columns.items()}


def drawn(model, episode):
    """Draws the robot's initial state and the targets of an episode from its generator.

    The dataset has the pose in float32 only.
    """
    random = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(episode,)))
    data = mujoco.MjData(model)
    robot.place(data, draw_quaternion(random))
    return data, {task: draw_target(task, random) for task in TASKS}


def test_actions_are_uniform_and_independent(steps):
    actions = steps["action"][:, :-1].astype(float)
    assert -1 <= actions.min() < -0.99
    assert 0.99 < actions.max() <= 1
    assert stats.kstest(actions.ravel(), stats.uniform(-1, 2).cdf).pvalue > 0.01
    # The correlation of 6000 independent pairs has a standard deviation of 0.013.
    assert abs(np.corrcoef(actions[:, 1:].ravel(), actions[:, :-1].ravel())[0, 1]) < 0.04
    assert np.abs(np.corrcoef(actions) - np.eye(6)).max() < 0.13  # 4 deviations of 1000 pairs


def test_recorded_actions_reproduce_recorded_states(steps):
    model = load_model()
    (data, _), seen = drawn(model, 5), []
    for action in [*steps["action"][5, :-1], None]:
        seen.append([*data.qpos[:7], *data.qvel[:6], data.qpos[15], data.qvel[14]])
        if action is not None:
            data.ctrl[0] = action
            mujoco.mj_step(model, data, nstep=50)
    expected = np.array(seen)
    expected[:, -2] = np.angle(np.exp(1j * (expected[:, -2] + math.pi / 2)))  # 0 is forward
    for index, name in enumerate(COLUMNS):
        found = steps[name][5]
        np.testing.assert_allclose(found, expected[:, index], rtol=2e-7, atol=1e-9, err_msg=name)


@EVERY_TASK
def test_observations_and_rewards_equal_environment(task, dataset, steps):
    expected = [np.concatenate(parts) for parts in zip(*dataset.blocks(task), strict=True)][:3]
    # The episode whose rewards vary most is compared to its end, of the others the first state.
    episode = np.argmax(np.ptp(expected[2][:, :COMPARED], axis=1))
    env = RobotEnv(task)
    for number in [*(n for n in range(6) if n != episode), episode]:
        _, targets = drawn(env.model, number)
        numbers = target_numbers(task, targets[task])
        env.np_random = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(number,)))
        first, _ = env.reset(options={"target": numbers} if len(numbers) else {})
        np.testing.assert_allclose(expected[0][number, 0], first, rtol=0, atol=1e-5)
    observations, rewards = [first], []
    actions = steps["action"][episode, :COMPARED]
    for action in actions:
        observation, reward, *_ = env.step(np.array([action]))
        observations.append(observation)
        rewards.append(reward)
    for ours, theirs in zip(expected, (observations, actions, rewards), strict=True):
        np.testing.assert_allclose(ours[episode, : len(theirs)], theirs, rtol=0, atol=1e-5)
    assert np.ptp(rewards) > 1e-3


@EVERY_TASK
def test_observations_precede_actions(task, dataset):
    observations = dataset.observations(task)
    assert (observations.shape, observations.dtype) == ((6, 1000, SIZES[task]), np.float32)
    blocks = np.concatenate([block.observations for block in dataset.blocks(task)])
    assert blocks.shape == (6, 1001, SIZES[task])
    np.testing.assert_array_equal(observations, blocks[:, :-1])
