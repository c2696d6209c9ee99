"""Tests of the observed features against scipy's rotations, MuJoCo and hand-computed cases."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import assume, example, given
from scipy.spatial.transform import Rotation

from jbench.names import TASKS
from jbench.tasks.find import find_task
from jbench.tasks.jitterbug import features, geometry, model, rewards
from jbench.tasks.jitterbug.geometry import State, Target
from tests.tasks.robot_states import (
    FEATURES,
    SIZES,
    convert,
    numbers,
    quaternions,
    random_states,
    rest,
    states,
    target,
    targets,
    turned,
    vectors,
)

PI = math.pi


def rotation(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True)


def close(actual, expected, tolerance=1e-12):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance)


@given(quaternions())
def test_rotation_matrix_equals_scipy(quaternion):
    close(geometry.rotation_matrix(quaternion), rotation(quaternion).as_matrix())


@given(states())
def test_heading_is_yaw_of_minus_y_axis(state):
    matrix = rotation(state.position[3:]).as_matrix()
    assume(math.hypot(matrix[0, 0], matrix[1, 0]) > 0.01)  # otherwise the yaw is undefined
    error = geometry.heading(state) - (math.atan2(matrix[1, 0], matrix[0, 0]) - PI / 2)
    close([math.cos(error), math.sin(error)], [1, 0])


@given(numbers(-1e4, 1e4) | numbers(-4, 4))
@example(PI)
@example(-PI)
@example(math.nextafter(PI, 4))
@example(math.nextafter(-PI, 0))
@example(-1.5 * PI)
def test_wrapped_angle_is_equivalent_and_within_pi(angle):
    wrapped = geometry.wrap_angle(np.float64(angle))
    turns = (angle - wrapped) / (2 * PI)
    assert -PI < wrapped <= PI
    assert turns == pytest.approx(round(turns), abs=1e-9)
    assert wrapped == angle or not -PI < angle <= PI


@pytest.mark.parametrize(
    ("joint", "motor"), [(-PI / 2, 0), (0, PI / 2), (PI / 2, PI), (PI, -PI / 2), (20 * PI, PI / 2)]
)
def test_motor_angle_is_zero_with_mass_forward(joint, motor):
    close(geometry.motor_angle(np.array(joint)), motor, 1e-13)


@pytest.mark.parametrize(
    ("robot_yaw", "target_yaw", "angle"),
    [
        (0, 0, PI / 2),  # it faces -y: a quarter turn to the left to look along x
        (0, -PI / 2, 0),
        (0, PI / 2, PI),  # half a turn is +pi, not -pi
        (0, PI, -PI / 2),
        (PI / 2, 0, 0),
        (PI / 2, 1.5 * PI, -PI / 2),
        (PI, PI / 4, -PI / 4),
    ],
)
def test_angle_to_target_by_hand(robot_yaw, target_yaw, angle):
    close(geometry.angle_to_target(turned(robot_yaw), target(yaw=target_yaw)), angle, 1e-15)


@given(states(), targets())
def test_target_in_jitterbug_frame_equals_scipy(state, goal):
    expected = rotation(state.position[3:]).inv().apply(goal.position - state.position[:3])
    close(geometry.target_in_jitterbug_frame(state, goal), expected)


@pytest.mark.parametrize(
    ("yaw", "speed"),
    [(0, (0.05, 0.02, 0.01)), (PI / 2, (0.02, -0.05, 0.01)), (PI, (-0.05, -0.02, 0.01))],
)
def test_speed_in_target_frame_by_hand(yaw, speed):
    state = rest(torso_velocity=[0.05, 0.02, 0.01])
    close(geometry.speed_in_target_frame(state, target(yaw=yaw)), speed)


@given(quaternions(), vectors(6, 35.0))
def test_velocity_of_center_of_mass_equals_mujoco_sensor(robot, quaternion, velocity):
    data = mujoco.MjData(robot)
    model.place(data, quaternion)
    data.qvel[:6] = velocity
    mujoco.mj_forward(robot, data)
    state = model.read_state(data.qpos, data.qvel, model.torso_offset(robot))
    close(state.torso_velocity, data.sensor("torso_velocity").data, 1e-12)


def test_state_of_splits_mujoco_state():
    qpos, qvel = np.arange(16.0), np.arange(100.0, 115)
    qpos[3:7] = 1, 0, 0, 0
    state = model.read_state(qpos, qvel, np.zeros(3))
    assert state.position.tolist() == [0, 1, 2, 1, 0, 0, 0]
    assert state.velocity.tolist() == [100, 101, 102, 103, 104, 105]
    assert state.torso_velocity.tolist() == [100, 101, 102]  # without offset, none of the rotation
    assert state.motor_position == pytest.approx(15 + PI / 2 - 6 * PI)  # 16.57 rad: 3 turns less
    assert state.motor_velocity == 114
    assert not any(np.shares_memory(part, whole) for part in state for whole in (qpos, qvel))


@pytest.mark.parametrize("task", TASKS)
def test_every_dimension_has_label_starting_with_feature(task):
    labels = find_task(task).labels
    owners = [name for name, size in FEATURES[task].items() for _ in range(size)]
    assert len(set(labels)) == len(labels)
    assert all(label.startswith(owner) for label, owner in zip(labels, owners, strict=True))


# At rest: z = 0.035 of 0 … 0.1 is 0.7 - 1 = -0.3; motor and target angle are pi / 2 of ±pi.
AT_REST = [0, 0, -0.3, 1, 0, 0, 0, *[0] * 6, 0.5, 0]
SEEN_AT_REST = {
    "move_from_origin": AT_REST,
    "face_direction": [*AT_REST, 0.5],
    "move_in_direction": [*AT_REST, 0.5, 0.05, 0.03, -0.02],
    "move_to_position": [*AT_REST, 0.05, -0.1, 0.4],
    "move_to_pose": [*AT_REST, 0.05, -0.1, 0.4, 0.5],
}


@pytest.mark.parametrize("task", TASKS)
def test_observation_at_rest_by_hand(task):
    state = rest(torso_velocity=[0.05, 0.03, -0.02])
    goal = target(x=0.15, y=-0.3, z=0.075)  # of ±3, ±3 and, against the torso, ±0.1
    close(features.observation(task, state, goal), SEEN_AT_REST[task])


def test_observation_is_not_clipped():
    state = rest(
        position=[4, -1, 0.2, 1, 0, 0, 0],  # of ±2, ±2, 0 … 0.1
        velocity=[2, -1, 0.5, 70, -35, 7],  # of ±1 and ±35
        motor_position=-PI,
        motor_velocity=270,  # of ±180
    )
    expected = [2, -0.5, 3, 1, 0, 0, 0, 2, -1, 0.5, 2, -1, 0.2, -1, 1.5]
    close(features.observation("move_from_origin", state, target()), expected)


@pytest.mark.parametrize("task", TASKS)
def test_denormalize_inverts_normalize(task):
    values = np.random.default_rng(0).uniform(-5, 5, (50, SIZES[task]))
    close(features.normalize(task, features.denormalize(task, values)), values)
    close(features.denormalize(task, features.normalize(task, values)), values)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("kind", ["numpy", "torch"])
@pytest.mark.parametrize("function", [features.observation, rewards.reward])
def test_batch_equals_single_robots_and_stays_float32(function, kind, task):
    many, goals = random_states((2, 3))
    goals = Target(*(part[0] for part in goals))  # three, for two robots each
    together = function(task, convert(many, kind), convert(goals, kind))
    assert tuple(together.shape)[:2] == (2, 3)
    for index in np.ndindex(2, 3):
        state, goal = State(*(x[index] for x in many)), Target(*(x[index[1]] for x in goals))
        alone = function(task, convert(state, kind), convert(goal, kind))
        close(together[index], alone, 1e-15)
    single = function(task, convert(many, kind, "float32"), convert(goals, kind, "float32"))
    assert str(single.dtype).endswith("float32")
    close(single, together, 1e-5)
