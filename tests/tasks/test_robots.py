"""Tests that the plain robot steps as MuJoCo does, with general collision, bit for bit."""

import mujoco
import numpy as np
import pytest
from dm_control import suite

from jbench.task_specs import PHYSICS_STEPS
from jbench.tasks.jitterbug import model

EVERYTHING = mujoco.mjtState.mjSTATE_INTEGRATION  # with the solver's warm start
HINGES = slice(7, 15)  # shoulders and elbows in qpos
WIDEST = 0.4  # rad, from the rest pose

# Pairs of the robot's own parts that touch within these angles: the motor's mass with the front
# legs, the crank with the back legs, the front legs with each other, the back legs as well.
TOUCHING = {
    *("leg2_upper mass", "leg3_upper mass", "crank_handle leg1_lower", "crank_handle leg4_lower"),
    *("leg2_foot leg3_foot", "leg2_foot leg3_lower", "leg2_lower leg3_foot"),
    *("leg1_foot leg4_foot", "leg1_foot leg4_lower", "leg1_lower leg4_foot"),
    *("leg2_lower leg3_lower", "leg1_lower leg4_lower"),
}
CONTACT = [
    *("geom", "dist", "pos", "frame", "dim", "includemargin", "efc_address"),
    *("friction", "solref", "solreffriction", "solimp", "mu"),
]


def full_state(data):
    state = np.empty(mujoco.mj_stateSize(data.model, EVERYTHING))
    mujoco.mj_getState(data.model, data, state, EVERYTHING)
    return state


def assert_same_contacts(ours, theirs):
    assert ours.ncon == theirs.ncon
    for field in CONTACT:
        found, expected = getattr(ours.contact, field), getattr(theirs.contact, field)
        np.testing.assert_array_equal(found, expected, field)


def touching(data):
    names = [sorted(data.model.geom(geom).name for geom in pair) for pair in data.contact.geom]
    return {" ".join(pair) for pair in names if "floor" not in pair}


def touch_itself(random, data):
    """Sets a state at rest in the air in which the legs are bent up to the widest angles."""
    model.place(data, model.UPRIGHT)
    data.qpos[2] = 1
    data.qpos[HINGES] = np.clip(random.normal(0, WIDEST, 8), -WIDEST, WIDEST)
    data.qpos[model.MOTOR] = random.uniform(-np.pi, np.pi)


@pytest.mark.parametrize(
    "control",
    [
        pytest.param(lambda random, step: random.uniform(-1, 1), id="random"),
        pytest.param(lambda random, step: 1, id="full", marks=pytest.mark.slow),
        pytest.param(
            lambda random, step: (-1) ** (step // 2), id="alternating", marks=pytest.mark.slow
        ),
        pytest.param(
            lambda random, step: random.choice([-1, 1]),
            id="random direction",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_states_equal_those_of_general_collision(robot, general, control):
    random = np.random.default_rng(0)
    ours, theirs = mujoco.MjData(robot), mujoco.MjData(general)
    most = 0
    for episode in range(8):
        # Lying on any side, so that all parts touch the floor, or upright.
        side = random.normal(size=4)
        quaternion = side / np.linalg.norm(side) if episode % 2 else model.UPRIGHT
        for data in (ours, theirs):
            model.place(data, quaternion)
        for step in range(60):
            ours.ctrl[0] = theirs.ctrl[0] = control(random, step)
            for data in (ours, theirs):
                mujoco.mj_step(data.model, data, nstep=PHYSICS_STEPS)
            np.testing.assert_array_equal(full_state(ours), full_state(theirs))
            most = max(most, ours.ncon)
            assert np.abs(ours.qpos[HINGES]).max() < WIDEST / 2
    assert_same_contacts(ours, theirs)
    assert most > 4  # more than four feet


@pytest.mark.slow
def test_contacts_of_robot_that_touches_itself_equal_general_collision(robot, general):
    random, seen = np.random.default_rng(0), set()
    ours, theirs = mujoco.MjData(robot), mujoco.MjData(general)
    for _ in range(20_000):
        touch_itself(random, theirs)
        ours.qpos[:] = theirs.qpos
        for data in (ours, theirs):
            mujoco.mj_kinematics(data.model, data)
            mujoco.mj_comPos(data.model, data)
            mujoco.mj_collision(data.model, data)
        assert ours.ncon == theirs.ncon
        if ours.ncon:
            assert_same_contacts(ours, theirs)
            seen |= touching(ours)
    assert seen == TOUCHING


def test_robot_that_touches_itself_moves_as_with_general_collision(robot, general):
    random, seen = np.random.default_rng(1), set()
    ours, theirs = mujoco.MjData(robot), mujoco.MjData(general)
    while seen < TOUCHING:
        touch_itself(random, theirs)
        theirs.qpos[2] = model.REST_HEIGHT  # floor contacts, too
        mujoco.mj_setState(robot, ours, full_state(theirs), EVERYTHING)
        for _ in range(10):
            for data in (ours, theirs):
                mujoco.mj_step(data.model, data)
            np.testing.assert_array_equal(full_state(ours), full_state(theirs))
            seen |= touching(ours)


@pytest.mark.parametrize("seed", range(3))
def test_control_step_of_dm_control_is_50_steps_of_mujoco(seed):
    env = suite.load("jitterbug", "move_from_origin", {"random": seed})
    env.reset()
    theirs = env.physics.data.ptr
    ours = mujoco.MjData(theirs.model)
    mujoco.mj_setState(theirs.model, ours, full_state(theirs), EVERYTHING)
    start = theirs.qpos.copy()
    # Some controls exceed the limits.
    for control in np.random.default_rng(seed).uniform(-1.2, 1.2, 30):
        env.step([control])
        ours.ctrl[0] = control
        for _ in range(PHYSICS_STEPS):
            mujoco.mj_step(ours.model, ours)
        np.testing.assert_array_equal(ours.qpos, theirs.qpos)
        np.testing.assert_array_equal(ours.qvel, theirs.qvel)
    assert not np.any(start[7:] == theirs.qpos[7:])  # every joint has moved
