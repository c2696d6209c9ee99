"""Tests of the `info` of an environment against hand-computed values and the reward."""

import math

import numpy as np
import pytest
from hypothesis import given

from jbench.names import TASKS
from jbench.tasks import features, rewards
from jbench.tasks.gym import outcome
from tests.tasks.robot_states import random_states, rest, states, target, targets

# At the origin, facing -y, moving at 0.05 m/s towards (0.03, -0.04).
STATE = rest(torso_velocity=[0.03, -0.04, 0])
GOAL = target(0.03, -0.04, yaw=-math.pi / 4)
NEAR = {"distance": 0.05, "reward_near": 0.1}
HEADING = {"angle": math.pi / 4, "reward_heading": 0.5}
BY_HAND = {
    "move_from_origin": {"distance": 0.05, "reward_away": 0.9},
    "face_direction": {"target": [-math.pi / 4], **HEADING},
    # The speed along the target is 0.07 / sqrt(2) m/s, of the full 0.1 m/s.
    "move_in_direction": {
        "target": [-math.pi / 4],
        "angle": math.pi / 4,
        "reward_speed": 0.7 / math.sqrt(2),
    },
    "move_to_position": {"target": [0.03, -0.04], **NEAR},
    "move_to_pose": {"target": [0.03, -0.04, -math.pi / 4], **NEAR, **HEADING},
}


@pytest.mark.parametrize("task", TASKS)
def test_info_by_hand(task):
    *_, info = outcome(task, STATE, GOAL)
    expected = {**BY_HAND[task], "reward_upright": 1}
    assert {key: np.asarray(value).tolist() for key, value in info.items()} == {
        key: pytest.approx(value, rel=1e-12) for key, value in expected.items()
    }


@pytest.mark.parametrize("task", TASKS)
@given(states(), targets())
def test_reward_is_product_of_terms_in_info(task, state, goal):
    _, reward, info = outcome(task, state, goal)
    terms = [float(value) for key, value in info.items() if key.startswith("reward_")]
    assert math.prod(terms) == reward == rewards.reward(task, state, goal)
    assert all(0 <= term <= 1 for term in terms)


@pytest.mark.parametrize("task", TASKS)
def test_batched_outcome_equals_single_outcomes(task):
    many, goals = random_states((4,))
    observations, together, infos = outcome(task, many, goals)
    expected = features.observation(task, many, goals).astype(np.float32)
    np.testing.assert_array_equal(observations, expected)
    for i in range(4):
        state, goal = (type(part)(*(x[i] for x in part)) for part in (many, goals))
        observation, reward, info = outcome(task, state, goal)
        np.testing.assert_array_equal(observation, observations[i])
        assert reward == together[i]
        assert info.keys() == infos.keys()
        for key, value in info.items():
            np.testing.assert_array_equal(value, infos[key][i])
