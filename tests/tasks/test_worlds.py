"""Tests of `Robots`, which steps many robots together, against a plain MuJoCo loop."""

import copy
import os

import mujoco
import numpy as np
import pytest

from jbench.tasks.jitterbug import model, resets
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots
from tests.command_line import Process


@pytest.fixture(scope="module")
def robot():
    return load_model()


def poses(count, seed=1):
    random = np.random.default_rng(seed)
    return np.stack([resets.draw_quaternion(random) for _ in range(count)])


def commands(steps, count, seed=2):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, count))


def take(robots, actions):
    """Takes control steps; returns the state after the last one."""
    for held in actions:
        state = robots.step(held)
    return state


def assert_same(first, second):
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def part_of(state, i):
    return [part[i] for part in state]


def alone(robot, quaternion, actions):
    """The state of a single robot after a plain loop, one physics step at a time."""
    data = mujoco.MjData(robot)
    model.place(data, quaternion)
    for command in actions:
        data.ctrl[0] = command
        for _ in range(50):
            mujoco.mj_step(robot, data)
    return model.read_state(data.qpos, data.qvel, model.torso_offset(robot))


def test_states_without_speed_are_otherwise_those_with_it(robot):
    actions = commands(10, 3)
    robots = Robots(robot, 3, 1, has_speed=False)
    with_speed = Robots(robot, 3, 1)
    for each in (robots, with_speed):
        each.reset(poses(3))
    assert take(with_speed, actions).torso_velocity.shape == (3, 3)
    expected = with_speed.restore(with_speed.snapshot())._replace(torso_velocity=None)
    assert_same(take(robots, actions), expected)
    copied = copy.deepcopy(robots)
    assert_same(copied.restore(copied.snapshot()), expected)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_robots_equal_plain_loop(robot, threads):
    actions = commands(20, 5)
    robots = Robots(robot, 5, threads)
    robots.reset(poses(5))
    state = take(robots, actions)
    for i, quaternion in enumerate(poses(5)):
        assert_same(part_of(state, i), alone(robot, quaternion, actions[:, i]))


@pytest.mark.parametrize("some", [[1, 3], np.array([False, True, False, True, False])])
def test_partial_reset_leaves_other_robots_unchanged(robot, some):
    actions, fresh = commands(20, 5), poses(2, seed=9)
    robots = Robots(robot, 5, 2)
    robots.reset(poses(5))
    before = take(robots, actions[:10])
    reset = robots.reset(fresh, some)
    state = take(robots, actions[10:])
    np.testing.assert_array_equal(reset.position[[1, 3], 3:], fresh)
    for i in (0, 2, 4):
        assert_same(part_of(reset, i), part_of(before, i))
        assert_same(part_of(state, i), alone(robot, poses(5)[i], actions[:, i]))
    for i, quaternion in zip((1, 3), fresh, strict=True):
        assert_same(part_of(state, i), alone(robot, quaternion, actions[10:, i]))


def test_restored_snapshot_gives_same_trajectory(robot):
    actions = commands(30, 4)
    robots = Robots(robot, 4, 2)
    robots.reset(poses(4))
    before = take(robots, actions[:15])
    snapshot = robots.snapshot()
    expected = take(robots, actions[15:])
    assert_same(robots.restore(snapshot), before)
    assert_same(take(robots, actions[15:]), expected)
    # Other robots can be restored from a subset in another order.
    others = Robots(robot, 3, 1)
    others.reset(poses(3, seed=8))
    others.restore(snapshot[[3, 1]], [0, 2])
    np.testing.assert_array_equal(others.snapshot([2, 0]), snapshot[[1, 3]])
    found = take(others, actions[15:][:, [3, 0, 1]])
    for here, there in ((0, 3), (2, 1)):
        assert_same(part_of(found, here), part_of(expected, there))


def test_states_are_copies(robot):
    robots = Robots(robot, 1, 1)
    state = robots.reset(poses(1))
    kept = [part.copy() for part in state]
    other = robots.step(np.ones(1))
    assert_same(state, kept)
    for part in (*state, *other):
        part[...] = 7
    again = robots.step(np.ones(1))
    assert_same(part_of(again, 0), alone(robot, poses(1)[0], [1.0, 1.0]))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_forked_process_steps_and_ends():
    done = Process("tests.tasks.forked_robots:step_in_two_processes").finished()
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == second
