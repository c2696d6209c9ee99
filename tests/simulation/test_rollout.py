"""Tests of rollouts of several robots against single Gymnasium environments."""

import numpy as np
import pytest

from jbench.simulation import find_task, rollout
from jbench.tasks import resets
from jbench.tasks.gym import JitterbugEnv

TASK, STEPS = "move_to_pose", 30


def act(observations):
    """A stateless policy."""
    return np.tanh(observations[:, -2:].sum(axis=1, keepdims=True))


@pytest.fixture
def steps():
    with find_task(TASK).worlds(2) as worlds:
        transitions = rollout(worlds, worlds.reset([*map(np.random.default_rng, (4, 5))]), act)
        return [next(transitions) for _ in range(STEPS)]


@pytest.mark.parametrize(("robot", "seed"), [(0, 4), (1, 5)])
def test_rollout_equals_environment(steps, robot, seed):
    env = JitterbugEnv(TASK)
    observation, _ = env.reset(seed=seed)
    for step in steps:
        assert np.array_equal(step.observations[robot], observation)
        action = act(observation[None])[0]
        assert step.actions[robot] == action[0]
        observation, reward, *_ = env.step(action)
        assert np.array_equal(step.next_observations[robot], observation)
        assert step.rewards[robot] == reward


def test_repeated_generator_draws_consecutive_starts():
    once, both = np.random.default_rng(7), np.random.default_rng(7)
    quaternions, targets = resets.draw_starts(TASK, [both, both])
    for i in range(2):
        assert np.array_equal(quaternions[i], resets.draw_quaternion(once))
        target = resets.draw_target(TASK, once)
        assert np.array_equal(targets.position[i], target.position)
        assert targets.yaw[i] == target.yaw
