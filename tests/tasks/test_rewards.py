"""Tests of rewards and `info` against dm_control's tolerance and hand-computed cases."""

import math

import numpy as np
import pytest
from dm_control.utils.rewards import tolerance
from hypothesis import given
from scipy.spatial.transform import Rotation

from jbench.names import TASKS
from jbench.tasks.jitterbug import rewards
from jbench.tasks.jitterbug.features import features
from jbench.tasks.jitterbug.worlds import describe
from tests.tasks.robot_states import convert, rest, states, target, targets

PI = math.pi


def expected_terms(state, goal):
    """Each term of a reward, computed by scipy's rotation and dm_control's tolerance."""
    matrix = Rotation.from_quat(state.position[3:], scalar_first=True).as_matrix()
    faces = math.atan2(matrix[1, 0], matrix[0, 0]) - PI / 2
    angle = (goal.yaw - faces + PI) % (2 * PI) - PI
    along = state.torso_velocity[:2] @ [math.cos(goal.yaw), math.sin(goal.yaw)]
    near = tolerance(np.linalg.norm(goal.position - state.position[:3]), margin=0.05)
    return {
        "upright": tolerance(matrix[2, 2], bounds=(1, math.inf), margin=0.5),
        "near": near,
        "away": 1 - near,
        "heading": tolerance(angle, margin=PI / 2, value_at_margin=0, sigmoid="cosine"),
        "speed": tolerance(
            along, bounds=(0.1, math.inf), margin=0.1, value_at_margin=0, sigmoid="linear"
        ),
    }


PRODUCTS = {
    "move_from_origin": ("away", "upright"),
    "face_direction": ("heading", "upright"),
    "move_in_direction": ("speed", "upright"),
    "move_to_position": ("near", "upright"),
    "move_to_pose": ("near", "heading", "upright"),
}


@pytest.mark.parametrize("kind", ["numpy", "torch"])
@given(states(), targets())
def test_reward_is_product_of_terms_that_equal_dm_control_tolerance(kind, state, goal):
    every = expected_terms(state, goal)
    state, goal = convert(state, kind), convert(goal, kind)
    for task, names in PRODUCTS.items():
        expected = {name: every[name] for name in names}
        found = rewards.reward_terms(task, state, goal)
        assert {n: float(term) for n, term in found.items()} == pytest.approx(expected, abs=1e-12)
        reward = float(rewards.reward(task, state, goal))
        assert reward == pytest.approx(math.prod(expected.values()), abs=1e-12)
        assert 0 <= reward <= 1


@pytest.mark.parametrize(
    ("task", "goal", "reward"),
    [
        ("move_from_origin", target(), 0),
        ("move_from_origin", target(x=0.05), 0.9),
        ("face_direction", target(x=9, yaw=-PI / 4), 0.5),
        ("move_in_direction", target(x=9), 0.3),
        ("move_to_position", target(x=0.05, yaw=PI / 2), 0.1),
        ("move_to_pose", target(x=0.05, yaw=-PI / 4), 0.05),
    ],
)
@pytest.mark.parametrize(("degrees", "upright"), [(0, 1), (60, 0.1)])
def test_reward_by_hand(task, goal, reward, degrees, upright):
    half = math.radians(degrees / 2)
    # Rolled about y, the axis of its heading, which therefore does not change.
    position = [0, 0, 0.035, math.cos(half), 0, math.sin(half), 0]
    state = rest(position=position, torso_velocity=[0.03, 0, 0])
    assert rewards.reward(task, state, goal) == pytest.approx(reward * upright, rel=1e-12)


# At the origin, facing -y, moving at 0.05 m/s towards (0.03, -0.04).
STATE = rest(torso_velocity=[0.03, -0.04, 0])
GOAL = target(0.03, -0.04, yaw=-PI / 4)
NEAR = {"distance": 0.05, "reward_near": 0.1}
HEADING = {"angle": PI / 4, "reward_heading": 0.5}
BY_HAND = {
    "move_from_origin": {"distance": 0.05, "reward_away": 0.9},
    "face_direction": {"target": [-PI / 4], **HEADING},
    # The speed along the target is 0.07 / sqrt(2) m/s, of the full 0.1 m/s.
    "move_in_direction": {"target": [-PI / 4], "angle": PI / 4, "reward_speed": 0.7 / math.sqrt(2)},
    "move_to_position": {"target": [0.03, -0.04], **NEAR},
    "move_to_pose": {"target": [0.03, -0.04, -PI / 4], **NEAR, **HEADING},
}


@pytest.mark.parametrize("task", TASKS)
def test_info_by_hand(task):
    seen = features(task, STATE, GOAL)
    terms = rewards.reward_terms(task, STATE, GOAL, seen)
    info = describe(task, STATE, GOAL, seen, terms)
    expected = {**BY_HAND[task], "reward_upright": 1}
    assert {key: np.asarray(value).tolist() for key, value in info.items()} == {
        key: pytest.approx(value, rel=1e-12) for key, value in expected.items()
    }
    assert math.prod(terms.values()) == rewards.reward(task, STATE, GOAL)
