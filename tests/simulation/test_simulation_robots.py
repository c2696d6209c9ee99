"""Many robots stepped together move as each would alone."""

import mujoco
import numpy as np
import pytest

from jbench.simulation import Robots
from jbench.tasks import model, resets


@pytest.fixture(scope="module")
def robot():
    return model.load()


def poses(count):
    random = np.random.default_rng(1)
    return np.stack([resets.draw_quaternion(random) for _ in range(count)])


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_robots_move_as_a_plain_loop_moves_each(robot, threads):
    actions = np.random.default_rng(2).uniform(-1, 1, (20, 5))
    with Robots(robot, 5, threads) as robots:
        robots.reset(poses(5))
        for held in actions:
            state = robots.step(held)
    for i, quaternion in enumerate(poses(5)):
        data = mujoco.MjData(robot)
        model.place(data, quaternion)
        for command in actions[:, i]:
            data.ctrl[0] = command
            for _ in range(50):
                mujoco.mj_step(robot, data)
        np.testing.assert_array_equal(state.position[i], data.qpos[:7])
        np.testing.assert_array_equal(state.velocity[i], data.qvel[:6])


def test_actions_beyond_one_count_as_one(robot):
    with Robots(robot, 2, 1) as robots:
        robots.reset(np.repeat(poses(1), 2, axis=0))
        for _ in range(10):
            state = robots.step(np.array([1.0, 9.0]))
    np.testing.assert_array_equal(state.position[0], state.position[1])


def test_a_reset_forgets_everything(robot):
    with Robots(robot, 3, 2) as robots:
        first = robots.reset(poses(3))
        one = robots.step(np.array([0.3, -1.0, 1.0]))
        robots.step(np.ones(3))
        again = robots.reset(poses(3))
        two = robots.step(np.array([0.3, -1.0, 1.0]))
    for before, after in ((first, again), (one, two)):
        for part, same in zip(before, after, strict=True):
            np.testing.assert_array_equal(part, same)


def test_states_are_the_callers_own(robot):
    with Robots(robot, 1, 1) as robots:
        state = robots.reset(poses(1))
        kept = state.position.copy()
        robots.step(np.ones(1))
    np.testing.assert_array_equal(state.position, kept)
