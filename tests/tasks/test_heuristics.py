"""Tests of the hand-written policies: mirror symmetry, batching, and returns on their tasks."""

import numpy as np
import pytest

from jbench.task_specs import TASK_SPECS, TaskSpec
from jbench.tasks.jitterbug import features, geometry, resets
from jbench.tasks.jitterbug.heuristics import LAWS
from jbench.tasks.jitterbug.rewards import reward
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots
from jbench.tasks.jitterbug.task import JitterbugTask


def some_observations(task, random, count=50):
    """Observations of upright, moving robots at random positions away from the origin."""
    quaternion, target = resets.draw_starts(task, [random] * count)
    position = random.uniform([-0.02, 0.04, 0.03], [0.02, 0.08, 0.04], (count, 3))
    state = geometry.State(
        position=np.concatenate([position, quaternion], axis=1),
        velocity=random.uniform(-1, 1, (count, 6)) * [0.2, 0.2, 0.1, 2, 2, 2],
        motor_position=random.uniform(-np.pi, np.pi, count),
        motor_velocity=random.uniform(-60, 60, count),
        torso_velocity=random.uniform(-0.2, 0.2, (count, 3)),
    )
    return features.observation(task, state, target)


@pytest.mark.parametrize("task", LAWS)
def test_mirrored_observation_gives_mirrored_action(task):
    observed = some_observations(task, np.random.default_rng(0))
    policy = LAWS[task]()
    policy.reset(len(observed))
    action = policy.act(observed)
    policy.reset(len(observed))
    assert np.abs(action).max() > 0.2
    assert policy.act(features.mirrored(task, observed)) == pytest.approx(-action, abs=1e-9)


@pytest.mark.parametrize("task", LAWS)
def test_action_is_independent_of_batch(task):
    observed = some_observations(task, np.random.default_rng(1), count=6)
    together, alone = LAWS[task](), LAWS[task]()
    together.reset(6)
    actions = together.act(observed)
    for row, action in zip(observed, actions, strict=True):
        alone.reset(1)
        assert alone.act(row[None]) == pytest.approx(action[None], abs=1e-12)


# Number of steps, and the least median reward of three robots over the last 50 of them.
DONE = {
    "move_from_origin": (150, 0.95),
    "face_direction": (250, 0.9),
    "move_in_direction": (150, 0.55),
    "move_to_position": (400, 0.8),
    "move_to_pose": (500, 0.7),
}


LONGER = ("move_to_position", "move_to_pose")


@pytest.mark.parametrize(
    "task",
    [pytest.param(task, marks=pytest.mark.slow if task in LONGER else ()) for task in DONE],
)
def test_heuristic_solves_task(task):
    quaternions, target = resets.draw_starts(task, [np.random.default_rng(2)] * 3)
    steps, least = DONE[task]
    policy = LAWS[task]()
    policy.reset(3)
    rewards = []
    robots = Robots(load_model(), 3, threads=2)
    state = robots.reset(quaternions)
    for _ in range(steps):
        state = robots.step(policy.act(features.observation(task, state, target))[:, 0])
        rewards.append(reward(task, state, target))
    assert np.median(np.mean(rewards[-50:], axis=0)) > least


def test_task_without_a_law_has_no_hand_written_policy(monkeypatch):
    """So that a new task is one row of the table."""
    monkeypatch.setitem(TASK_SPECS, "stay_upright", TaskSpec(("position",), ("upright",)))
    assert JitterbugTask("stay_upright").hand_written() is None
    assert JitterbugTask("face_direction").hand_written() is not None
