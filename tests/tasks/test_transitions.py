"""Tests that a control step equals 50 physics steps of MuJoCo, bit for bit."""

import mujoco
import numpy as np
import pytest
from dm_control import suite

from jbench.names import PHYSICS_STEPS
from jbench.tasks import model
from jbench.tasks.robots import load_model

EVERYTHING = mujoco.mjtState.mjSTATE_INTEGRATION  # what the next step depends on


def full_state(robot, data):
    state = np.empty(mujoco.mj_stateSize(robot, EVERYTHING))
    mujoco.mj_getState(robot, data, state, EVERYTHING)
    return state


def controls(seed):
    """Controls of thirty control steps, some of which exceed the limits."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, 30)


def step_one_by_one(robot, data, control):
    data.ctrl[0] = control
    for _ in range(PHYSICS_STEPS):
        mujoco.mj_step(robot, data)


@pytest.mark.parametrize("seed", range(3))
def test_control_step_of_dm_control_is_50_steps_of_mujoco(seed):
    env = suite.load("jitterbug", "move_from_origin", {"random": seed})
    env.reset()
    robot, theirs = env.physics.model.ptr, env.physics.data.ptr
    ours = mujoco.MjData(robot)
    mujoco.mj_setState(robot, ours, full_state(robot, theirs), EVERYTHING)
    start = theirs.qpos.copy()
    for control in controls(seed):
        env.step([control])
        step_one_by_one(robot, ours, control)
        np.testing.assert_array_equal(ours.qpos, theirs.qpos)
        np.testing.assert_array_equal(ours.qvel, theirs.qvel)
    assert not np.any(start[7:] == theirs.qpos[7:])  # every joint has moved


def test_place_clears_state_of_last_episode():
    robot = load_model()
    used, new = mujoco.MjData(robot), mujoco.MjData(robot)
    step_one_by_one(robot, used, 1.0)
    for data in (used, new):
        model.place(data, np.array([0, 0, 0, 1.0]))
        step_one_by_one(robot, data, 0.5)
    np.testing.assert_array_equal(full_state(robot, used), full_state(robot, new))
