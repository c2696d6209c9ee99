"""Tests of the planar reduction and of its variants: invariance, reconstruction, and mirror."""

import math

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from jbench.encoders import action_signs
from jbench.encoders.kinds.planar import (
    HeadingFrame,
    PlanarMirror,
    PlanarReduction,
    PlanarWithoutYawRate,
    planar_weights,
)
from jbench.encoders.predictions import predictions
from jbench.names import TASKS
from jbench.task_specs import TASK_SPECS
from jbench.tasks.find import find_task
from jbench.tasks.jitterbug import features, geometry, model
from jbench.tasks.jitterbug.geometry import State, Target
from jbench.tasks.jitterbug.robots import load_model
from tests.encoders.encoder_data import (
    PLANAR_SIZES,
    make_dataset,
    planar_encoder,
    random_states,
    range_without_symmetry,
    read_states,
)

KIND = PlanarReduction()
OFFSET = np.array([0.001, -0.002, 0.004])  # center of mass of the torso (m)


def turned_by(angle, quaternion):
    """Rotates a quaternion about the vertical axis."""
    found, turn = np.zeros(4), np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)])
    mujoco.mju_mulQuat(found, turn, quaternion)
    return found


def horizontal(angle, vector):
    """Rotates a vector (3,) about the vertical axis."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ vector


def moved(state, target, angle, shift):
    """Robot and target after a rotation about the vertical axis and a shift (3,)."""
    place = horizontal(angle, state.position[:3]) + shift
    position = np.concatenate([place, turned_by(angle, state.position[3:])])
    velocity = np.concatenate([horizontal(angle, state.velocity[:3]), state.velocity[3:]])
    torso_velocity = horizontal(angle, state.torso_velocity)
    state = state._replace(position=position, velocity=velocity, torso_velocity=torso_velocity)
    return state, Target(horizontal(angle, target.position) + shift, target.yaw + angle)


def robot(position, quaternion, velocity, motor, target):
    """A state and a target of given numbers."""
    quaternion = np.array(quaternion) / np.linalg.norm(quaternion)
    position, velocity = np.array([*position, *quaternion]), np.array(velocity)
    state = State(
        position=position,
        velocity=velocity,
        motor_position=np.array(motor[0]),
        motor_velocity=np.array(motor[1]),
        torso_velocity=geometry.center_of_mass_velocity(position, velocity, OFFSET),
    )
    height = geometry.TARGET_HEIGHT
    return state, Target(np.array([*target[:2], height]), np.array(target[2]))


def numbers(*bounds):
    return st.tuples(*(st.floats(-b, b, allow_subnormal=False) for b in bounds))


robots = st.builds(
    robot,
    numbers(0.2, 0.2, 0.05),
    # A robot that is upside down, or whose x axis is vertical, has no heading.
    numbers(1, 1, 1, 1).filter(
        lambda q: (
            q[0] ** 2 + q[3] ** 2 > 0.01 and abs(q[1] * q[3] - q[0] * q[2]) < 0.49 * np.dot(q, q)
        )
    ),
    numbers(1, 1, 1, 20, 20, 20),
    numbers(3, 150),
    numbers(0.2, 0.2, 3),
)
tasks = st.sampled_from(TASKS)


def features_in(task, state, target):
    """Features (dim(O),) in SI units."""
    return np.concatenate(list(features.features(task, state, target).values()))


def weights_of(task):
    """A scaling other than that of the observation, and weights with it."""
    scaling = range_without_symmetry(features.observation_size(task))
    extremes = range_without_symmetry(PLANAR_SIZES[task])
    return scaling, planar_weights(task, scaling, extremes, OFFSET)


def encoded(task, state, target):
    """Weights, scaled observation and latents of a robot, in float64."""
    scaling, weights = weights_of(task)
    half_width, center = scaling.half_width_and_center()
    scaled = (features.observation(task, state, target) - center) / half_width
    return weights, scaled, KIND.encode(weights, scaled)


def at_origin(task, target):
    """The target of a task: at the origin, unless the task draws its position."""
    if "x" in TASK_SPECS[task].drawn:
        return target
    return target._replace(position=np.array([0, 0, geometry.TARGET_HEIGHT]))


@settings(max_examples=70, deadline=None)
@given(tasks, robots, st.floats(-math.pi, math.pi), numbers(3, 3))
def test_latents_are_invariant_to_planar_motions(task, found, angle, shift):
    state, target = found[0], at_origin(task, found[1])
    if task == "move_from_origin":
        shift = (0, 0)
    weights, _, before = encoded(task, state, target)
    _, _, after = encoded(task, *moved(state, target, angle, np.array([*shift, 0.0])))
    assert before.shape == (PLANAR_SIZES[task],)
    in_units_of_pi = weights["latent.gain"][-1] / math.pi
    difference = after - before
    if "angle_to_target" in TASK_SPECS[task].features:
        turns = difference[-1] * in_units_of_pi / 2
        difference[-1] = (turns - round(turns)) / in_units_of_pi * 2
    np.testing.assert_allclose(difference, 0, atol=1e-8)


@settings(max_examples=70, deadline=None)
@given(tasks, robots)
def test_observation_is_reconstructed_up_to_planar_motion(task, found):
    state, target = found[0], at_origin(task, found[1])
    weights, _, latents = encoded(task, state, target)
    rebuilt = KIND.decode(weights, latents)
    # The same robot with heading 0 and, unless that changes the reward, at the origin.
    quaternion = state.position[3:]
    state, target = moved(state, target, -2 * math.atan2(quaternion[3], quaternion[0]), 0)
    if task != "move_from_origin":
        state, target = moved(state, target, 0, -state.position[:3] * [1, 1, 0])
    if state.position[3] < 0:  # both signs are the same orientation
        state.position[3:] *= -1
    _, expected, _ = encoded(task, state, target)
    scaling, _ = weights_of(task)
    half_width, _ = scaling.half_width_and_center()
    difference = (rebuilt - expected) * half_width
    labels = find_task(task).labels
    if "angle_to_target" in labels:
        # An angle at the end of its range, observed in units of pi.
        at = labels.index("angle_to_target")
        difference[at] -= 2 * round(difference[at] / 2)
    np.testing.assert_allclose(difference, 0, atol=1e-8)


def test_planar_numbers_equal_values_computed_by_hand():
    # The robot is on its side: rotated by 90 degrees to the left, then by 90 about its x axis.
    root = math.sqrt(0.5)
    quaternion = turned_by(math.pi / 2, [root, root, 0, 0])
    state, target = robot(
        (1.0, 2.0, 0.03), quaternion, (0.1, 0.2, 0.3, 1, 2, 3), (0.5, 7), (1, 2.5, 0.0)
    )
    found = KIND.reduce("move_to_pose", features_in("move_to_pose", state, target))
    # The heading is north, in which the velocity is 0.2 m/s and the target is 0.5 m away. The y
    # axis of the robot points up, its z axis to the right. The robot faces -y, which is down; by
    # the yaw of its x axis it faces east, and so does the target.
    expected = [0.03, root, 0, 0.2, -0.1, 0.3, 1, -3, 2, 0.5, 7, 0.5, 0, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_upside_down_robot_has_finite_numbers():
    state, target = robot((0, 0, 0.03), (0, 1, 0, 0), [0] * 6, (0, 0), (0, 0, 0))
    _, _, latents = encoded("face_direction", state, target)
    assert np.isfinite(latents).all()


@pytest.mark.parametrize("task", TASKS)
def test_numpy_and_torch_agree_for_any_leading_axes(task):
    _, weights = weights_of(task)
    size = features.observation_size(task)
    rows = np.random.default_rng(0).uniform(-1, 1, (2, 5, size))
    in_torch = {name: torch.from_numpy(value) for name, value in weights.items()}
    latents = KIND.encode(weights, rows)
    assert latents.shape == (2, 5, PLANAR_SIZES[task])
    seen = torch.from_numpy(rows)
    np.testing.assert_allclose(KIND.encode(in_torch, seen).numpy(), latents, atol=1e-12)
    rebuilt = KIND.decode(weights, latents)
    again = KIND.decode(in_torch, torch.from_numpy(latents))
    np.testing.assert_allclose(again.numpy(), rebuilt, atol=1e-12)


def next_numbers(physics, angle, shift):
    """The planar numbers one control step after a planar motion, which follows 1 s of shaking."""
    data = mujoco.MjData(physics)
    model.place(data, np.array([1.0, 0, 0, 0]))
    data.ctrl[0] = 0.7
    mujoco.mj_step(physics, data, nstep=5000)
    data.qpos[:3] = horizontal(angle, data.qpos[:3]) + shift
    data.qpos[3:7] = turned_by(angle, data.qpos[3:7])
    data.qvel[:3] = horizontal(angle, data.qvel[:3])
    data.ctrl[0] = -0.4
    mujoco.mj_step(physics, data, nstep=50)
    state = model.read_state(data.qpos, data.qvel, model.torso_offset(physics))
    seen = features_in("face_direction", state, Target(np.zeros(3), np.array(0.0)))
    return KIND.reduce("face_direction", seen)[:-1]


@pytest.mark.parametrize(
    ("cone", "angle"),
    [("PYRAMIDAL", 0.0), ("PYRAMIDAL", math.pi / 2), ("ELLIPTIC", 1.0), ("ELLIPTIC", -2.5)],
)
def test_physics_is_invariant_to_position_and_heading(cone, angle):
    # A pyramidal friction cone is aligned with the world's axes: it is invariant to quarter turns.
    physics = load_model()
    physics.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{cone}")
    at_home = next_numbers(physics, 0.0, np.zeros(3))
    elsewhere = next_numbers(physics, angle, np.array([0.3, -0.2, 0.0]))
    np.testing.assert_allclose(elsewhere, at_home, atol=1e-9)


@given(robots, tasks)
def test_heading_keeps_all_features_but_sign_of_quaternion(pair, task):
    state, target = pair[0], at_origin(task, pair[1])
    physical = features_in(task, state, target)
    numbers = HeadingFrame().reduce(task, physical)
    assert len(numbers) in HeadingFrame().latent_sizes(task, len(numbers))
    np.testing.assert_array_equal(numbers[: PLANAR_SIZES[task]], KIND.reduce(task, physical))
    restored = HeadingFrame().restore(task, numbers, OFFSET)
    restored[3:7] *= np.sign(restored[3:7] @ physical[3:7])
    np.testing.assert_allclose(restored, physical, atol=1e-6, rtol=1e-6)


@given(robots, tasks)
def test_planar_without_yaw_rate_leaves_out_only_that(pair, task):
    state, target = pair[0], at_origin(task, pair[1])
    physical = features_in(task, state, target)
    planar = KIND.reduce(task, physical)
    numbers = PlanarWithoutYawRate().reduce(task, physical)
    np.testing.assert_array_equal(numbers, np.delete(planar, 8))


def target_side(task, state, target):
    """The angle or the lateral way to the target, positive on the left, and whether it is clear."""
    if "angle_to_target" in TASK_SPECS[task].features:
        angle = geometry.angle_to_target(state, target)
        return angle, 1e-3 < abs(angle) < math.pi - 1e-3
    way = (target.position - state.position[:3])[:2]
    # The robot's left is the x axis of its frame, turned by the twist of its orientation.
    twist = 2 * math.atan2(state.position[6], state.position[3])
    lateral = math.cos(twist) * way[0] + math.sin(twist) * way[1]
    return lateral, abs(lateral) > 1e-3


@given(tasks, robots)
def test_state_and_mirror_image_have_equal_latents_and_opposite_actions(task, found):
    state, target = found[0], at_origin(task, found[1])
    side, is_clear = target_side(task, state, target)
    assume(is_clear)
    encoder, plain = planar_encoder(task, PlanarMirror), planar_encoder(task, PlanarReduction)
    observed = features.observation(task, state, target)
    seen = torch.from_numpy(np.stack([observed, features.mirrored(task, observed)]))
    latents, signs = encoder.encode(seen), action_signs(encoder, seen)
    # In half of the observations' range, the encoder's numbers in float32 are 1e-7 from an image.
    torch.testing.assert_close(latents[0], latents[1], rtol=0, atol=1e-4)
    assert signs.tolist() == [[1.0], [-1.0]] if side > 0 else [[-1.0], [1.0]]
    # What is not reflected is the planar reduction itself.
    left = int(side < 0)
    assert torch.equal(latents[left], plain.encode(seen)[left])


def test_probe_predicts_mirrored_robot(results):
    # States that last for ten control steps, so that the next rates follow from the latents.
    state = State(*(np.repeat(part[:, ::10], 10, axis=1)[:, :1001] for part in random_states(5)))
    states = read_states(make_dataset(results, state=state))
    for kind in (PlanarReduction(), PlanarMirror()):
        rows = predictions(kind, kind.fit(states, 12), states)
        r2 = {row["target"]: row["r2"] for row in rows if row["target"] != "reward"}
        assert r2.keys() >= {"yaw_rate", "tilt_rate", "forward_speed"}
        assert min(r2.values()) > 0.6
