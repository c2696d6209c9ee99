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
    qpos, qvel = on_threads(threads, model, *given)
    assert (qpos.shape, qvel.shape) == ((EPISODES, STEPS + 1, 16), (EPISODES, STEPS + 1, 15))
    for episode, (quaternion, actions) in enumerate(zip(*given, strict=True)):
        expected = plain_loop(model, quaternion, actions)
        np.testing.assert_array_equal(qpos[episode], expected[0])
        np.testing.assert_array_equal(qvel[episode], expected[1])
    assert np.ptp(qpos[:, -1], axis=0).min() > 0  # each robot went elsewhere
    np.testing.assert_array_equal(qpos[:, 0, :3], [[0, 0, 0.035]] * EPISODES)
    np.testing.assert_array_equal(qpos[:, 0, 3:7], given[0])


def test_two_models_on_same_threads_do_not_interfere(model, given):
    other = load_model()
    other.opt.gravity[2] *= 2
    other.qpos0[robot.MOTOR] = 1  # where its motor begins
    with ThreadPoolExecutor(2) as workers, ThreadPoolExecutor(2) as callers:
        jobs = [callers.submit(simulate, one, *given, workers) for one in (model, other) * 2]
        together = [job.result()[0] for job in jobs]
    for one, qpos in zip((model, other) * 2, together, strict=True):
        np.testing.assert_array_equal(qpos, on_threads(1, one, *given)[0])
        np.testing.assert_array_equal(qpos[0], plain_loop(one, given[0][0], given[1][0])[0])
    assert not np.any(together[0][:, 1:, 2] == together[1][:, 1:, 2])
