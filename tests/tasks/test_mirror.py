"""Tests of the mirror: observations, rewards, the simulated robot, and the start of episodes."""

import mujoco
import numpy as np
import pytest
import torch

from jbench.names import TASKS
from jbench.tasks.jitterbug import features, model, resets, rewards
from jbench.tasks.jitterbug.features import mirrored
from jbench.tasks.jitterbug.geometry import Target
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.task import episode_generator

# In qpos, behind the torso's 7 numbers: shoulder and elbow of legs 2, 3, 1 and 4, then the motor.
OTHER_LEG = [2, 3, 0, 1, 6, 7, 4, 5]


def mirror_image(qpos, qvel):
    """The simulator's state (16,) and (15,) after a reflection at the plane x = 0."""
    legs = -qpos[7:15][OTHER_LEG]
    pose = qpos[:7] * [-1, 1, 1, 1, 1, -1, -1]
    rates = [*(qvel[:6] * [-1, 1, 1, 1, -1, -1]), *-qvel[6:14][OTHER_LEG], -qvel[14]]
    return np.array([*pose, *legs, np.pi - qpos[15]]), np.array(rates)


def shaken(physics, random):
    """The simulation after half a second of random actions."""
    data = mujoco.MjData(physics)
    model.place(data, resets.draw_quaternion(random))
    for _ in range(50):
        data.ctrl[0] = random.uniform(-1, 1)
        mujoco.mj_step(physics, data, nstep=50)
    data.qacc_warmstart[:] = 0
    return data


def mirror_error(physics, seed):
    """Largest errors of positions and of velocities a control step after a reflection."""
    random = np.random.default_rng(seed)
    one, other = shaken(physics, random), mujoco.MjData(physics)
    other.qpos[:], other.qvel[:] = mirror_image(one.qpos, one.qvel)
    one.ctrl[0] = random.uniform(-1, 1)
    other.ctrl[0] = -one.ctrl[0]
    for data in (one, other):
        mujoco.mj_step(physics, data, nstep=50)
    pairs = zip(mirror_image(one.qpos, one.qvel), (other.qpos, other.qvel), strict=True)
    return [np.abs(image - found).max() for image, found in pairs]


def test_mirrored_robot_moves_as_mirror_image():
    errors = np.array([mirror_error(load_model(), seed) for seed in range(15)])
    assert np.median(errors, 0) == pytest.approx([0, 0], abs=2e-3)
    assert np.all(errors.max(0) < [5e-5, 0.02])


@pytest.mark.parametrize("cone", ["PYRAMIDAL", "ELLIPTIC"])
def test_mirror_is_exact_with_exact_inertias_of_constraints(cone):
    physics = load_model()
    physics.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{cone}")
    physics.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_DIAGEXACT
    for seed in range(5):
        np.testing.assert_allclose(mirror_error(physics, seed), 0, atol=1e-10)


@pytest.mark.parametrize("task", TASKS)
def test_observation_and_reward_of_mirror_image(task):
    physics, random = load_model(), np.random.default_rng(len(task))
    for _ in range(3):
        data = shaken(physics, random)
        target = resets.draw_target(task, random)
        # Positions x and directions (cos, sin) of the target are reflected.
        image = Target(target.position * [-1, 1, 1], np.pi - target.yaw)
        offset = model.torso_offset(physics)
        # Reflection moves the center of mass, which is in the middle only to 1e-18 m.
        state = model.read_state(data.qpos, data.qvel, offset)
        other = model.read_state(*mirror_image(data.qpos, data.qvel), offset)
        seen = features.observation(task, state, target)
        expected = features.observation(task, other, image)
        found = mirrored(task, seen)
        # The image has the quaternion (w, x, -y, -z), and its negative is the same orientation.
        expected[3:7] *= -1
        np.testing.assert_allclose(found, expected, atol=1e-12)
        np.testing.assert_array_equal(mirrored(task, found), seen)
        np.testing.assert_array_equal(mirrored(task, torch.from_numpy(seen[None]))[0], found)
        reward = rewards.reward(task, state, target)
        assert rewards.reward(task, other, image) == pytest.approx(reward, abs=1e-12)


def test_mirror_image_of_start_is_possible_start():
    for seed in range(20):
        state = np.zeros(16)
        state[3:7] = resets.draw_quaternion(episode_generator(seed, 0))
        w, x, y, z = mirrored("face_direction", state)[3:7]
        # A rotation by 0 to 2 pi about an axis (u, v, 1) with |u|, |v| <= 0.025; see `resets`.
        assert z > 0
        assert max(abs(x), abs(y)) <= 0.025 * z
        assert w == -state[3]
