"""Tests of rollouts of several robots against single Gymnasium environments."""

import numpy as np

from jbench.tasks.find import find_task
from jbench.tasks.gym import RobotEnv
from jbench.tasks.jitterbug import resets
from jbench.tasks.task import rollout

TASK = "move_to_pose"


def act(observations):
    return np.tanh(observations[:, -2:].sum(axis=1, keepdims=True))


def test_rollout_equals_environments():
    with find_task(TASK).worlds(2) as worlds:
        transitions = rollout(worlds, worlds.reset([*map(np.random.default_rng, (4, 5))]), act)
        steps = [next(transitions) for _ in range(30)]
    for robot, seed in ((0, 4), (1, 5)):
        env = RobotEnv(TASK)
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
