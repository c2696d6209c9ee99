"""Tests of the domain `jitterbug` of the dm_control suite: properties of all five tasks."""

import math

import dm_env
import numpy as np
import pytest
from dm_control import suite
from dm_env import specs

from jbench.names import TASKS
from jbench.tasks import features, rewards
from jbench.tasks.geometry import Target

COMMON = {"position": 7, "velocity": 6, "motor_position": 1, "motor_velocity": 1}
SHAPES = {
    "move_from_origin": COMMON,
    "face_direction": COMMON | {"angle_to_target": 1},
    "move_in_direction": COMMON | {"angle_to_target": 1, "speed_in_target_frame": 3},
    "move_to_position": COMMON | {"target_in_jitterbug_frame": 3},
    "move_to_pose": COMMON | {"target_in_jitterbug_frame": 3, "angle_to_target": 1},
}

# A random policy's median returns are 892 and 282; single episodes vary around them.
RANDOM_RETURNS = {"move_from_origin": (400, 990), "move_in_direction": (100, 500)}

EVERY_TASK = pytest.mark.parametrize("task", TASKS)


def load(task, random=0, visualize_reward=False, environment_kwargs=None, **settings):
    settings = {"random": random, **settings}
    return suite.load("jitterbug", task, settings, environment_kwargs, visualize_reward)


def roll_out(env, steps, seed=0):
    """The time steps of the first `steps` of an episode with random actions."""
    actions = np.random.default_rng(seed)
    return [env.reset(), *(env.step(actions.uniform(-1, 1, 1)) for _ in range(steps))]


def flat(time_step):
    return np.concatenate(list(time_step.observation.values()))


@pytest.fixture(
    scope="module",
    params=[
        task if task in RANDOM_RETURNS else pytest.param(task, marks=pytest.mark.slow)
        for task in TASKS
    ],
)
def episode(request):
    """A task and a complete episode of it."""
    env = load(request.param)
    return request.param, [*roll_out(env, 999), env.step([0.5])]


def test_suite_lists_five_tasks():
    ours = {("jitterbug", task) for task in TASKS}
    assert ours <= set(suite.ALL_TASKS)
    assert ours <= set(suite.BENCHMARKING)
    assert ours <= set(suite.REWARD_VIZ)
    assert not ours & set(suite.EXTRA)
    assert suite.TASKS_BY_DOMAIN["jitterbug"] == TASKS
    # In the paper's order of rising difficulty, every task is either easy or hard.
    assert ours & set(suite.EASY) == {("jitterbug", task) for task in TASKS[:3]}
    assert ours & set(suite.HARD) == {("jitterbug", task) for task in TASKS[3:]}


def test_suite_keeps_its_own_tasks():
    assert ("cartpole", "balance") in suite.BENCHMARKING
    assert ("humanoid", "stand") in suite.ALL_TASKS
    assert len(suite.ALL_TASKS) == len(set(suite.ALL_TASKS))
    assert len(suite.ALL_TASKS) == sum(map(len, suite.TASKS_BY_DOMAIN.values()))


@EVERY_TASK
def test_observation_and_action_specs(task):
    env = load(task)
    assert {name: spec.shape for name, spec in env.observation_spec().items()} == {
        name: (size,) for name, size in SHAPES[task].items()
    }
    assert {spec.dtype for spec in env.observation_spec().values()} == {np.dtype(float)}
    assert list(env.observation_spec()) == list(SHAPES[task])
    assert env.action_spec() == specs.BoundedArray((1,), float, [-1], [1])


def test_episode_has_1000_steps_and_ends_with_discount_one(episode):
    _, (first, *middle, last) = episode
    assert len(middle) + 1 == 1000
    assert first.first()
    assert {step.step_type for step in middle} == {dm_env.StepType.MID}
    assert last.last()
    assert (first.reward, first.discount) == (None, None)
    assert {step.discount for step in [*middle, last]} == {1.0}


def test_rewards_are_between_zero_and_one(episode):
    task, (_, *steps) = episode
    rewards = [step.reward for step in steps]
    low, high = RANDOM_RETURNS.get(task, (0, 1000))
    assert all(type(reward) is float and 0 <= reward <= 1 for reward in rewards)
    assert low <= sum(rewards) <= high


@EVERY_TASK
def test_reward_and_observation_are_of_state_after_step(task):
    env = load(task, random=4)
    time_step = roll_out(env, 30)[-1]
    state, target = env.physics.robot_state(), env.physics.target()
    assert time_step.reward == rewards.reward(task, state, target)
    np.testing.assert_array_equal(flat(time_step), features.observation(task, state, target))


@EVERY_TASK
def test_observation_shares_no_memory_with_simulator(task):
    env = load(task)
    first = env.reset()
    kept = flat(first)
    second = env.step([1.0])
    data = env.physics.data
    memory = [data.qpos, data.qvel, data.sensordata, data.xpos, data.xmat]
    for name, values in second.observation.items():
        assert not np.shares_memory(values, first.observation[name])
        assert not any(np.shares_memory(values, part) for part in memory)
    np.testing.assert_array_equal(flat(first), kept)
    assert not any(np.shares_memory(s, m) for s in env.physics.robot_state() for m in memory)
    assert not any(np.shares_memory(t, m) for t in env.physics.target() for m in memory)


@EVERY_TASK
def test_robot_without_random_pose_starts_at_rest(task):
    env = load(task, random_pose=False)
    env.reset()
    assert env.physics.data.qpos.tolist() == [0, 0, 0.035, 1, *[0] * 12]
    assert not env.physics.data.qvel.any()


@pytest.mark.parametrize("yaw", [-3.0, -math.pi / 2, 0, 1.0, math.pi])
def test_set_target_is_returned(yaw):
    physics = load("move_to_pose").physics
    physics.set_target(Target(np.array([0.1, -0.2, 0.035]), yaw))
    physics.forward()
    np.testing.assert_allclose(physics.target().position, [0.1, -0.2, 0.035], atol=1e-15)
    assert physics.target().yaw == pytest.approx(yaw, abs=1e-15)


@pytest.mark.parametrize(("yaw", "blend"), [(-math.pi / 2, 1), (math.pi / 2, 0)])
def test_visualize_reward_colors_robot(yaw, blend):
    env = load("face_direction", visualize_reward=True, random_pose=False)
    env.reset()
    env.physics.set_target(Target(np.array([0, 0, 0.035]), yaw))
    env.physics.forward()
    env.step([0.0])  # it faces -y: the reward is 1 with that target, 0 with the other
    colors = env.physics.named.model.mat_rgba
    for material in ("self", "effector", "target"):
        plain, lit = colors[f"{material}_default"], colors[f"{material}_highlight"]
        assert np.abs(lit - plain).max() > 0.1
        np.testing.assert_allclose(colors[material], plain + blend * (lit - plain), atol=0.01)
