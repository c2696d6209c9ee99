"""The planar reduction: what it must not depend on, and that it loses nothing else."""

import math

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from jbench.encoders.kinds.planar import PlanarReduction, planar_weights, to_planar
from jbench.encoders.scaling import Scaling
from jbench.names import TASKS
from jbench.tasks import features, model
from jbench.tasks.features import State, Target
from jbench.tasks.labels import feature_labels
from jbench.tasks.robots import load_model

KIND = PlanarReduction()
OFFSET = np.array([0.001, -0.002, 0.004])  # centre of mass of the torso (m)
SIZES = {
    "move_from_origin": 13,
    "face_direction": 12,
    "move_in_direction": 12,
    "move_to_position": 13,
    "move_to_pose": 14,
}


def turned_by(angle, quaternion):
    """The product of a turn about the vertical and a quaternion."""
    found = np.zeros(4)
    mujoco.mju_mulQuat(
        found, np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)]), quaternion
    )
    return found


def horizontal(angle, vector):
    """A vector (3,) turned about the vertical."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ vector


def moved(state, target, angle, shift):
    """Robot and target after a turn about the vertical at the origin and a shift (3,)."""
    position = np.concatenate(
        [
            horizontal(angle, state.position[:3]) + shift,
            turned_by(angle, state.position[3:]),
        ]
    )
    velocity = np.concatenate([horizontal(angle, state.velocity[:3]), state.velocity[3:]])
    return (
        state._replace(
            position=position,
            velocity=velocity,
            torso_velocity=horizontal(angle, state.torso_velocity),
        ),
        Target(horizontal(angle, target.position) + shift, target.yaw + angle),
    )


def robot(position, quaternion, velocity, motor, target):
    """A state and a target of plain numbers."""
    quaternion = np.array(quaternion) / np.linalg.norm(quaternion)
    position, velocity = np.array([*position, *quaternion]), np.array(velocity)
    state = State(
        position=position,
        velocity=velocity,
        motor_position=np.array(motor[0]),
        motor_velocity=np.array(motor[1]),
        torso_velocity=features.center_of_mass_velocity(position, velocity, OFFSET),
    )
    height = features.TARGET_HEIGHT
    return state, Target(np.array([*target[:2], height]), np.array(target[2]))


def numbers(*bounds):
    return st.tuples(*(st.floats(-b, b, allow_subnormal=False) for b in bounds))


robots = st.builds(
    robot,
    numbers(0.2, 0.2, 0.05),
    # Not upside down, where there is no heading.
    numbers(1, 1, 1, 1).filter(lambda q: q[0] ** 2 + q[3] ** 2 > 0.01),
    numbers(1, 1, 1, 20, 20, 20),
    numbers(3, 150),
    numbers(0.2, 0.2, 3),
)
angles = st.floats(-math.pi, math.pi)
tasks = st.sampled_from(TASKS)


def weights_of(task):
    """Weights with a scaling that is not that of the observation."""
    size = features.TASK_SPECS[task].observation_size
    random = np.random.default_rng(size)
    low, high = -random.uniform(0.2, 1, (2, size)).astype(np.float32)
    scaling = Scaling(low, high + 2)
    low, high = -random.uniform(0.2, 1, (2, SIZES[task])).astype(np.float32)
    return scaling, planar_weights(task, scaling, Scaling(low, high + 2), OFFSET)


def encoded(task, state, target):
    """Weights, scaled observation and latents of a robot, in float64."""
    scaling, weights = weights_of(task)
    half_width, center = scaling.half_width_and_center()
    scaled = (features.observation(task, state, target) - center) / half_width
    return weights, scaled, KIND.encode(weights, scaled)


def at_origin(task, target):
    """The target where a task puts it: one that draws no place leaves it at the origin."""
    if features.TASK_SPECS[task].draws_position:
        return target
    return target._replace(position=np.array([0, 0, features.TARGET_HEIGHT]))


@settings(max_examples=200, deadline=None)
@given(tasks, robots, angles, numbers(3, 3))
def test_motions_in_the_plane_change_no_latent(task, found, angle, shift):
    state, target = found[0], at_origin(task, found[1])
    if task == "move_from_origin":
        shift = (0, 0)
    weights, _, before = encoded(task, state, target)
    _, _, after = encoded(task, *moved(state, target, angle, np.array([*shift, 0.0])))
    assert before.shape == (SIZES[task],)
    in_units_of_pi = weights["latent.gain"][-1] / math.pi
    difference = after - before
    if "angle_to_target" in features.TASK_SPECS[task].features:
        turns = difference[-1] * in_units_of_pi / 2
        difference[-1] = (turns - round(turns)) / in_units_of_pi * 2
    np.testing.assert_allclose(difference, 0, atol=1e-8)


@settings(max_examples=200, deadline=None)
@given(tasks, robots)
def test_an_observation_is_rebuilt_up_to_a_motion_in_the_plane(task, found):
    state, target = found[0], at_origin(task, found[1])
    weights, _, latents = encoded(task, state, target)
    rebuilt = KIND.decode(weights, latents)
    # The same robot, turned to heading 0 and, unless that changes the reward, to the origin.
    quaternion = state.position[3:]
    state, target = moved(state, target, -2 * math.atan2(quaternion[3], quaternion[0]), 0)
    if task != "move_from_origin":
        state, target = moved(state, target, 0, -state.position[:3] * [1, 1, 0])
    if state.position[3] < 0:  # either quaternion is of the same orientation
        state.position[3:] *= -1
    _, expected, _ = encoded(task, state, target)
    scaling, _ = weights_of(task)
    half_width, _ = scaling.half_width_and_center()
    difference = (rebuilt - expected) * half_width
    labels = feature_labels(task)
    if "angle_to_target" in labels:
        # An angle at the end of its range, observed in units of pi.
        at = labels.index("angle_to_target")
        difference[at] -= 2 * round(difference[at] / 2)
    np.testing.assert_allclose(difference, 0, atol=1e-8)


@given(robots, tasks)
def test_both_quaternions_of_an_orientation_have_the_same_latents(found, task):
    state, target = found
    _, _, before = encoded(task, state, target)
    other = np.concatenate([state.position[:3], -state.position[3:]])
    _, _, after = encoded(task, state._replace(position=other), target)
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_numbers_of_a_robot_worked_out_by_hand():
    # It lies on its side: turned by 90 degrees to the left, then by 90 degrees about its own x.
    root = math.sqrt(0.5)
    quaternion = turned_by(math.pi / 2, [root, root, 0, 0])
    state, target = robot(
        (1.0, 2.0, 0.03), quaternion, (0.1, 0.2, 0.3, 1, 2, 3), (0.5, 7), (1, 2.5, 0.0)
    )
    physical = np.concatenate(list(features.features("move_to_pose", state, target).values()))
    found = to_planar("move_to_pose", physical)
    # North, where it goes at 0.2 m/s and the target is 0.5 m off, is ahead along its heading. Its
    # y axis points up and its z axis to the right. It faces -y: straight down, or by the yaw of
    # its x axis east; the target looks there.
    expected = [0.03, root, 0, 0.2, -0.1, 0.3, 1, -3, 2, 0.5, 7, 0.5, 0, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_an_upside_down_robot_has_numbers():
    state, target = robot((0, 0, 0.03), (0, 1, 0, 0), [0] * 6, (0, 0), (0, 0, 0))
    _, _, latents = encoded("face_direction", state, target)
    assert np.isfinite(latents).all()


@pytest.mark.parametrize("task", TASKS)
def test_numpy_and_torch_agree_for_any_leading_axes(task):
    _, weights = weights_of(task)
    size = features.TASK_SPECS[task].observation_size
    rows = np.random.default_rng(0).uniform(-1, 1, (2, 5, size))
    in_torch = {name: torch.from_numpy(value) for name, value in weights.items()}
    latents = KIND.encode(weights, rows)
    assert latents.shape == (2, 5, SIZES[task])
    seen = torch.from_numpy(rows)
    np.testing.assert_allclose(KIND.encode(in_torch, seen).numpy(), latents, atol=1e-12)
    rebuilt = KIND.decode(weights, latents)
    again = KIND.decode(in_torch, torch.from_numpy(latents))
    np.testing.assert_allclose(again.numpy(), rebuilt, atol=1e-12)


def next_numbers(physics, angle, shift):
    """The planar numbers a control step after a motion of the plane, from 1 s of shaking on."""
    data = mujoco.MjData(physics)
    model.place(data, np.array([1.0, 0, 0, 0]))
    data.ctrl[0] = 0.7
    mujoco.mj_step(physics, data, nstep=5000)
    data.qpos[:3] = horizontal(angle, data.qpos[:3]) + shift
    data.qpos[3:7] = turned_by(angle, data.qpos[3:7])
    data.qvel[:3] = horizontal(angle, data.qvel[:3])
    data.ctrl[0] = -0.4
    mujoco.mj_step(physics, data, nstep=50)
    state = model.state_of(data.qpos, data.qvel, model.torso_offset(physics))
    seen = features.features("face_direction", state, Target(np.zeros(3), np.array(0.0)))
    return to_planar("face_direction", np.concatenate(list(seen.values())))[:-1]


@pytest.mark.parametrize(
    ("cone", "angle"),
    [("PYRAMIDAL", 0.0), ("PYRAMIDAL", math.pi / 2), ("ELLIPTIC", 1.0), ("ELLIPTIC", -2.5)],
)
def test_physics_does_not_depend_on_place_and_heading(cone, angle):
    # A pyramid of friction lies along the axes of the world: it is the same after quarter turns.
    physics = load_model()
    physics.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{cone}")
    at_home = next_numbers(physics, 0.0, np.zeros(3))
    elsewhere = next_numbers(physics, angle, np.array([0.3, -0.2, 0.0]))
    np.testing.assert_allclose(elsewhere, at_home, atol=1e-9)
