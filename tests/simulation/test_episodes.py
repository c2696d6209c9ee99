"""Tests of the threaded simulation of episodes against a plain MuJoCo loop, bit for bit."""

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from jbench.simulation import simulate
from jbench.tasks import model as robot
from jbench.tasks.resets import draw_quaternion
from jbench.tasks.robots import load_model

EPISODES, STEPS = 5, 25


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def given():
    """Initial orientations and actions, some of which exceed the limits."""
    random = np.random.default_rng(0)
    quaternions = np.stack([draw_quaternion(random) for _ in range(EPISODES)])
    return quaternions, random.uniform(-1.2, 1.2, (EPISODES, STEPS)).astype(np.float32)


def on_threads(count, model, quaternions, actions):
    with ThreadPoolExecutor(count) as executor:
        return simulate(model, quaternions, actions, executor)


def plain_loop(model, quaternion, actions):
    """One robot, one physics step of 0.2 ms at a time."""
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0.035, *quaternion]
    qpos, qvel = [data.qpos.copy()], [data.qvel.copy()]
    for action in actions:
        data.ctrl[:] = action
        for _ in range(50):
            mujoco.mj_step(model, data)
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
    return np.stack(qpos), np.stack(qvel)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threaded_simulation_equals_plain_loop(model, given, threads):
    found = on_threads(threads, model, *given)
    for episode, (quaternion, actions) in enumerate(zip(*given, strict=True)):
        qpos, qvel = plain_loop(model, quaternion, actions)
        np.testing.assert_array_equal(found.qpos[episode], qpos)
        np.testing.assert_array_equal(found.qvel[episode], qvel)
    assert np.ptp(found.qpos[:, -1], axis=0).min() > 0  # each robot went elsewhere


def test_first_state_is_initial_pose(model, given):
    found = on_threads(2, model, *given)
    assert found.qpos.shape == (EPISODES, STEPS + 1, 16)
    assert found.qvel.shape == (EPISODES, STEPS + 1, 15)
    np.testing.assert_array_equal(found.qpos[:, 0, :3], [[0, 0, 0.035]] * EPISODES)
    np.testing.assert_array_equal(found.qpos[:, 0, 3:7], given[0])
    np.testing.assert_array_equal(found.qpos[:, 0, 7:], 0)
    np.testing.assert_array_equal(found.qvel[:, 0], 0)


def test_thread_keeps_no_state_between_episodes(model, given):
    with ThreadPoolExecutor(1) as executor:
        first = simulate(model, *given, executor)
        again = simulate(model, *given, executor)
    np.testing.assert_array_equal(again.qpos, first.qpos)
    np.testing.assert_array_equal(again.qvel, first.qvel)


def test_two_models_on_same_threads_do_not_interfere(model, given):
    other = load_model()
    other.opt.gravity[2] *= 2
    other.qpos0[robot.MOTOR] = 1  # where its motor begins
    models = (model, other)
    alone = [on_threads(1, one, *given) for one in models]
    with ThreadPoolExecutor(2) as workers, ThreadPoolExecutor(2) as callers:
        jobs = [callers.submit(simulate, one, *given, workers) for one in models * 2]
        together = [job.result() for job in jobs]
    for found, expected in zip(together, alone * 2, strict=True):
        np.testing.assert_array_equal(found.qpos, expected.qpos)
    for one, trajectories in zip(models, alone, strict=True):
        qpos, _ = plain_loop(one, given[0][0], given[1][0])
        np.testing.assert_array_equal(trajectories.qpos[0], qpos)
    assert not np.any(alone[0].qpos[:, 1:, 2] == alone[1].qpos[:, 1:, 2])
