"""Tests of the domains of the dm_control suite, and of augmented robots there and in Gymnasium."""

import math

import dm_env
import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import suite
from dm_control.suite.wrappers import pixels
from dm_env import specs

from jbench.errors import RequestError
from jbench.names import TASKS
from jbench.registration import environment_id
from jbench.tasks.gym import RobotEnv
from jbench.tasks.jitterbug import features, rewards, robots
from jbench.tasks.jitterbug.geometry import Target
from jbench.tasks.jitterbug.robots import load_model
from tests.tasks.robot_states import FEATURES

# A random policy's median returns are 892 and 282; single episodes vary around them.
RANDOM_RETURNS = {"move_from_origin": (400, 990), "move_in_direction": (100, 500)}

EVERY_TASK = pytest.mark.parametrize("task", TASKS)


def load(task, random=0, visualize_reward=False, environment_kwargs=None, **settings):
    settings = {"random": random, **settings}
    return suite.load("jitterbug", task, settings, environment_kwargs, visualize_reward)


def roll_out(env, steps):
    """The time steps of the first `steps` of an episode with random actions."""
    actions = np.random.default_rng(0)
    return [env.reset(), *(env.step(actions.uniform(-1, 1, 1)) for _ in range(steps))]


def flat(time_step):
    return np.concatenate(list(time_step.observation.values()))


def test_suite_lists_five_tasks_and_keeps_its_own():
    ours = {("jitterbug", task) for task in TASKS}
    assert ours <= set(suite.ALL_TASKS)
    assert ours <= set(suite.BENCHMARKING)
    assert ours <= set(suite.REWARD_VIZ)
    assert not ours & set(suite.EXTRA)
    assert suite.TASKS_BY_DOMAIN["jitterbug"] == TASKS
    # In the paper's order of rising difficulty, every task is either easy or hard.
    assert ours & set(suite.EASY) == {("jitterbug", task) for task in TASKS[:3]}
    assert ours & set(suite.HARD) == {("jitterbug", task) for task in TASKS[3:]}
    assert ("cartpole", "balance") in suite.BENCHMARKING
    ours = {("augmented_jitterbug", task) for task in TASKS}
    assert suite.TASKS_BY_DOMAIN["augmented_jitterbug"] == TASKS
    assert ours <= set(suite.EXTRA)
    assert not ours & set(suite.BENCHMARKING)
    assert len(suite.ALL_TASKS) == len(set(suite.ALL_TASKS))
    assert len(suite.ALL_TASKS) == sum(map(len, suite.TASKS_BY_DOMAIN.values()))


@EVERY_TASK
def test_observation_and_action_specs(task):
    env = load(task)
    observed = [(name, spec.shape, spec.dtype) for name, spec in env.observation_spec().items()]
    assert observed == [(name, (size,), float) for name, size in FEATURES[task].items()]
    assert env.action_spec() == specs.BoundedArray((1,), float, [-1], [1])


@pytest.mark.parametrize(
    "task", ["move_from_origin", pytest.param("move_in_direction", marks=pytest.mark.slow)]
)
def test_episode_has_1000_rewards_between_zero_and_one_and_ends_with_discount_one(task):
    env = load(task)
    first, *middle, last = [*roll_out(env, 999), env.step([0.5])]
    assert len(middle) + 1 == 1000
    assert first.first()
    assert {step.step_type for step in middle} == {dm_env.StepType.MID}
    assert last.last()
    assert (first.reward, first.discount) == (None, None)
    assert {step.discount for step in [*middle, last]} == {1.0}
    rewards = [step.reward for step in [*middle, last]]
    assert all(type(reward) is float and 0 <= reward <= 1 for reward in rewards)
    low, high = RANDOM_RETURNS[task]
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


def final_positions(env):
    """The robot's joint positions after random actions from a seeded start."""
    env.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (50, 1)):
        env.step(action.astype(np.float32))
    return env.unwrapped.data.qpos.copy()


@pytest.mark.parametrize(
    "make",
    [
        robots.draw,
        load_model,
        lambda seed: RobotEnv("face_direction", augment=seed),
        lambda seed: gymnasium.make("AugmentedJitterbug/MoveToPose-v0", augment=seed),
        lambda seed: suite.load("augmented_jitterbug", "move_to_pose", {"augment": seed}),
    ],
)
def test_negative_seed_is_refused(make):
    with pytest.raises(RequestError) as refusal:
        make(-2)
    assert isinstance(refusal.value, ValueError)
    assert str(refusal.value) == "An augmented robot has no seed -2: use 0 or more."


def test_varied_masses_without_seed_are_refused():
    with pytest.raises(ValueError, match="give its seed"):
        load_model(vary_masses=True)


def test_dm_control_model_equals_model_of_seed_bit_for_bit():
    settings = {"augment": 3, "vary_masses": True}
    physics = suite.load("augmented_jitterbug", "move_to_pose", settings).physics
    models = physics.model.ptr, load_model(3, vary_masses=True)
    buffers = [np.zeros(mujoco.mj_sizeModel(each), np.uint8) for each in models]
    for each, buffer in zip(models, buffers, strict=True):
        mujoco.mj_saveModel(each, None, buffer)
    np.testing.assert_array_equal(*buffers)


@pytest.mark.parametrize(
    "task", [TASKS[0], *(pytest.param(task, marks=pytest.mark.slow) for task in TASKS[1:])]
)
def test_gymnasium_environment_has_robot_of_its_seed(task):
    name = environment_id(task, augmented=True)
    assert name == environment_id(task).replace("Jitterbug", "AugmentedJitterbug")
    for env, seed in ((gymnasium.make(name), 0), (gymnasium.make(name, augment=3), 3)):
        assert env.spec.max_episode_steps == 1000
        expected = final_positions(RobotEnv(task, augment=seed))
        np.testing.assert_array_equal(final_positions(env), expected)


@pytest.mark.usefixtures("coarse_pictures")
def test_dm_control_observes_pixels():
    plain = suite.load("jitterbug", "move_to_pose", {"random": 3})
    quality = plain.physics.model.vis.quality
    quality.shadowsize, quality.offsamples = 64, 0
    env = pixels.Wrapper(plain, render_kwargs={"width": 84, "height": 64, "camera_id": "overhead"})
    spec = env.observation_spec()
    assert list(spec) == ["pixels"]
    assert (spec["pixels"].shape, spec["pixels"].dtype) == ((64, 84, 3), np.uint8)
    seen = [env.reset()] + [env.step(np.ones(1, np.float32)) for _ in range(10)]
    for step in seen:
        spec["pixels"].validate(step.observation["pixels"])
    shown = env.physics.render(width=84, height=64, camera_id="overhead")
    np.testing.assert_array_equal(seen[-1].observation["pixels"], shown)
    assert np.any(seen[0].observation["pixels"] != shown)  # the robot has moved
    plain.physics.free()
