"""Tests of engines: independent seeds, resuming, and agreement with stable-baselines3."""

import json
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
import safetensors.torch
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.agents import sb3
from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.off_policy import ActionNoise, OffPolicyEngine
from jbench.agents.environments import Environments, Generators, SeedState
from jbench.agents.memory import memory_error
from jbench.errors import RequestError, WorkError
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import ALGORITHMS, SETTINGS, algorithm_settings
from jbench.settings.records import OFESettings
from jbench.tasks.gym import RobotEnv
from tests.matrices import diagonal
from tests.training.small_runs import TanhEncoder

LENGTH = 20  # control steps of an episode
SMALL = {
    "ddpg": {"train_freq": 10, "gradient_steps": 5, "learning_starts": 16, "batch_size": 16},
    "td3": {"train_freq": 12, "gradient_steps": 6, "learning_starts": 20, "batch_size": 16},
    "sac": {"learning_starts": 30, "batch_size": 16},
    "ppo": {"n_envs": 2, "n_steps": 15, "batch_size": 16, "n_epochs": 2},
}
STEPS = 64
RESUMED = 96  # after the updates that follow a restored state
BETWEEN_EPISODES = 120  # rollouts and episodes end, with all settings here
CHEETAH = {"task": "dmc:cheetah-run"}  # 6 motors
SWIMMER = {"task": "dmc:swimmer-swimmer6"}  # 5 motors; its target is part of the model
# The authors' script settings with the small step counts above.
SCRIPTS = {
    algo: {"changes": {**kind.bases["script"], **SMALL[algo]}}
    for algo, kind in SETTINGS.items()
    if "script" in kind.bases
}

# Learned features: fewer than the 16 observed numbers (used alone) and more (appended).
FEW, MANY = (OFESettings(units=units, layers=3, standardize_updates=20) for units in (6, 20))


def build_settings(algo, **changes):
    small = {"hidden_layers": [33, 20], "learning_rate": 1e-3} | SMALL[algo]
    small |= {} if algo == "ppo" else {"buffer_size": 50}
    return algorithm_settings(algo, overrides=small | changes)


def build_engine(algo, seeds, *, task="face_direction", changes=None, **options):
    return short_engine(algo, build_settings(algo, **(changes or {})), task, seeds, **options)


def short_engine(
    algo, settings, task, seeds, environments=None, encoder=None, device="cpu", **options
):
    """An engine with short episodes; `options` are of `Environments` and `make_batched_engine`."""
    about = {name: options.pop(name) for name in ("augment", "episode_steps") if name in options}
    encoders = encoder if isinstance(encoder, list) else [encoder] * len(seeds)
    count = environments or getattr(settings, "n_envs", 1)
    robots = Environments(task, seeds, count, encoders, **{"episode_steps": LENGTH, **about})
    return make_batched_engine(algo, settings, robots, device=torch.device(device), **options)


def trajectory(engine, index, steps=STEPS):
    """Trains; returns the observations, returns, losses and final state of a seed."""
    seen, returns, losses = [], [], []
    for ends in engine.learn(steps):
        seen.append(engine.environments.observations[index].clone())
        losses.append(engine.losses(index))
        returns.append(None if ends is None else ends.returns[index].tolist())
    tensors, scalars = engine.state(index)
    return torch.stack(seen), returns, losses, tensors, json.dumps(scalars)


def assert_same(one, other):
    assert torch.equal(one[0], other[0])
    assert one[1:3] == other[1:3]
    assert one[3].keys() == other[3].keys()
    for name, tensor in one[3].items():
        assert torch.equal(tensor, other[3][name]), name
    assert one[4] == other[4]


def assert_independent(make, steps=STEPS):
    """Asserts that a seed learns alone what it learns among others, bit for bit."""
    with make([7, 5, 3]) as together, make([3]) as alone:
        torch.randn(3)  # the global generator is not used
        among = trajectory(together, 2, steps)
        assert_same(trajectory(alone, 0, steps), among)
        other, same = together.environments.observations[[0, 2]]
        assert not torch.equal(other, same)
    assert any(among[1])
    assert among[2][-1]


def round_trip(state):
    """Writes a state as safetensors and JSON, and reads it."""
    tensors = safetensors.torch.load(safetensors.torch.save(state.tensors))
    return SeedState(tensors, json.loads(json.dumps(state.scalars)))


def stopped_at(engine, steps):
    """Trains for some control steps; returns states, replay rows and the next row's number."""
    for _ in engine.learn(2 * STEPS):
        if engine.control_steps >= steps:
            break
    states = [round_trip(engine.state(index)) for index in range(2)]
    if not isinstance(engine, OffPolicyEngine):
        return states, [], 0
    return states, [engine.replay.rows_since(index) for index in range(2)], engine.replay.row


def resume(engine, states, rows, row):
    """Restores an engine from the results of `stopped_at`."""
    for index, seed_rows in enumerate(rows):
        engine.replay.restore(index, seed_rows, row)
    engine.restore(states)
    return engine


def assert_continues(make, stop, steps=RESUMED):
    """Asserts that engines restored at a control step continue bit for bit."""
    with make([0, 4]) as engine:
        whole = trajectory(engine, 1, steps)
    with make([0, 4]) as engine:
        saved = stopped_at(engine, stop)
    with make([8, 9]) as other:
        rest = trajectory(resume(other, *saved), 1, steps)
    done = len(whole[0]) - len(rest[0])
    assert 0 < done < len(whole[0])
    assert_same((whole[0][done:], whole[1][done:], whole[2][done:], *whole[3:]), rest)


def assert_policies_equal_agents(engine):
    """Asserts that the policies as files act as the agents; returns the actions."""
    seeds, size = engine.environments.observations.shape[::2]
    observations = np.random.default_rng(0).normal(size=(seeds, 8, size)).astype(np.float32)
    actions = engine.act(observations)
    assert actions.shape == (seeds, 8, engine.environments.action_size)
    assert abs(actions).max() <= 1
    for index in range(seeds):
        policy = SavedNetwork.from_files(*engine.policy(index).files().values())
        np.testing.assert_allclose(policy.act(observations[index]), actions[index], atol=2e-6)
    assert not np.array_equal(actions[0], actions[-1])
    return actions


def assert_loads(make):
    """Asserts that an agent acts as the one whose policy it loads, bit for bit."""
    observations = np.random.default_rng(0).normal(size=(1, 10, 16)).astype(np.float32)
    with make([0]) as engine, make([9]) as other:
        list(engine.learn(60))
        before = other.act(observations)
        other.load_policy(0, engine.policy(0), 60)
        assert not np.array_equal(other.act(observations), before)
        np.testing.assert_array_equal(other.act(observations), engine.act(observations))
        assert other.control_steps == 60
        wrong = SavedNetwork(engine.policy(0).layers[:-1])
        with pytest.raises(ValueError, match="its layers are not those of its settings"):
            other.load_policy(0, wrong, 60)


def slow(*values):
    """Returns test parameters that only `make test-slow` runs."""
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        ("ddpg", {}),
        ("ppo", {}),
        slow("td3", {}),
        slow("sac", {}),
        *(slow(*case) for case in SCRIPTS.items()),
        slow("ddpg", {**SCRIPTS["ddpg"], "precision": "bfloat16"}),
        ("td3", {"precision": "bfloat16"}),
        ("sac", {"environments": 3, "time_limit": "terminal"}),
        slow("ddpg", {"encoder": TanhEncoder()}),
        slow("ddpg", {"ofe": FEW, "precision": "bfloat16"}),
        slow("td3", {"ofe": MANY}),
        ("sac", {"ofe": FEW, "environments": 2}),
        slow("ddpg", {"task": "move_to_pose"}),
        ("td3", CHEETAH),
        *(slow(algo, CHEETAH) for algo in ALGORITHMS if algo != "td3"),
        slow("ddpg", {**SWIMMER, **SCRIPTS["ddpg"], "environments": 2}),
        slow("sac", {**CHEETAH, "ofe": FEW}),
        slow("td3", {**CHEETAH, "ofe": MANY}),
        slow("ppo", {**SWIMMER, "changes": {"shared_layers": True}}),
    ],
)
def test_seed_is_independent_of_other_seeds_bit_for_bit(algo, options):
    steps = BETWEEN_EPISODES if "task" in options else STEPS
    assert_independent(lambda seeds: build_engine(algo, seeds, **options), steps)


@pytest.mark.parametrize(
    ("algo", "options", "stop"),
    [
        ("ddpg", {}, 40),
        slow("td3", {"time_limit": "terminal"}, 40),
        ("td3", {"augment": lambda episode: episode % 3, "ofe": FEW}, 43),
        slow("td3", {"augment": lambda episode: episode % 3}, 43),
        ("sac", {"environments": 2}, 45),
        ("ppo", {}, 60),
        slow("ppo", {"encoder": TanhEncoder()}, 49),
        slow("ppo", SCRIPTS["ppo"], 49),
        slow("ddpg", SCRIPTS["ddpg"], 40),
        slow("ddpg", {"ofe": MANY}, 30),
        slow("td3", {"ofe": FEW}, 43),
        slow("sac", {"ofe": MANY}, 45),
        # After two or four episodes, and an incomplete rollout of PPO and TD3.
        ("td3", SWIMMER, 4 * LENGTH),
        *(slow(algo, SWIMMER, 4 * LENGTH) for algo in ALGORITHMS if algo != "td3"),
        slow("td3", {**SWIMMER, "changes": {"action_noise": "ornstein-uhlenbeck"}}, 4 * LENGTH),
        slow("sac", {**SWIMMER, "ofe": MANY, "environments": 2}, 4 * LENGTH),
    ],
)
def test_restored_engine_continues_bit_for_bit(algo, options, stop):
    steps = BETWEEN_EPISODES if "task" in options else RESUMED
    assert_continues(lambda seeds: build_engine(algo, seeds, **options), stop, steps)


def test_environments_equal_gymnasium_environment():
    actions = np.random.default_rng(0).uniform(-1, 1, (2 * LENGTH + 1, 2, 2, 1))
    robots = (None, 3, 4)  # of each episode
    plain = [[RobotEnv("move_to_pose", augment=robot) for _ in range(4)] for robot in robots]
    same = [generator for seed in (3, 4) for generator in Generators(seed, 2).environments]
    for envs in plain:
        for env, generator in zip(envs, same, strict=True):
            env.np_random = generator
    envs = plain[0]
    seen = [env.reset()[0] for env in envs]
    with closing(
        Environments(
            "move_to_pose", (3, 4), 2, episode_steps=LENGTH, threads=2, augment=robots.__getitem__
        )
    ) as environments:
        np.testing.assert_array_equal(environments.observations.reshape(4, -1), seen)
        returns = np.zeros(4)
        for number, held in enumerate(actions, 1):
            step = environments.step(held)
            done = [env.step(a) for env, a in zip(envs, held.reshape(4, 1), strict=True)]
            np.testing.assert_array_equal(step.observations.reshape(4, -1), [d[0] for d in done])
            np.testing.assert_array_equal(step.rewards.reshape(4), [d[1] for d in done])
            returns += step.rewards.reshape(4)
            assert (step.ends is None) == (number % LENGTH != 0)
            if step.ends is not None:
                np.testing.assert_array_equal(step.ends.returns.reshape(4), returns)
                returns[:] = 0
                envs = plain[number // LENGTH]
                seen = [env.reset()[0] for env in envs]
                np.testing.assert_array_equal(environments.observations.reshape(4, -1), seen)
    assert environments.episodes == 2


@pytest.mark.parametrize(
    ("algo", "ofe"), [*((algo, None) for algo in ALGORITHMS), ("td3", FEW), ("sac", MANY)]
)
def test_loaded_policy_equals_agent_bit_for_bit(algo, ofe):
    assert_loads(lambda seeds: build_engine(algo, seeds, ofe=ofe))


@pytest.mark.parametrize(
    ("algo", "planned"), diagonal(("ddpg", "td3", "sac"), ((60, 60), (65, 0), (60, 59)))
)
def test_update_counts_equal_stable_baselines3(algo, planned):
    steps, starts = planned
    changes = {"learning_starts": starts, "hidden_layers": [4]}
    settings = build_settings(algo, **changes)
    env = DummyVecEnv([lambda: RobotEnv("face_direction")])
    agent = sb3.build(algo, settings, env, 0)
    agent.learn(steps, log_interval=None)
    with build_engine(algo, [0], changes=changes) as engine:
        list(engine.learn(steps))
    assert (engine.updates, engine.control_steps) == (agent._n_updates, agent.num_timesteps)


@pytest.mark.parametrize(
    ("environments", "changes", "updates"),
    [
        # The first updates follow the first rollout that ends after 16 control steps.
        (5, {}, 5 * (120 - 10) // 10),
        (10, {}, 5 * (120 - 10) // 10),
        (20, {}, 120 * 5 // 10),
        (3, {"train_freq": 1, "gradient_steps": 2}, 2 * (120 - 15)),
    ],
)
def test_ratio_of_updates_is_independent_of_environments(environments, changes, updates):
    with build_engine("ddpg", [0], environments=environments, changes=changes) as engine:
        list(engine.learn(120))
        assert (engine.control_steps, engine.updates) == (120, updates)


@pytest.mark.parametrize(("environments", "first"), [(1, 30), (3, 27), (4, 24), (12, 24)])
def test_first_update_is_where_the_settings_say(environments, first):
    changes = {"learning_starts": 20, "train_freq": 10, "gradient_steps": 10}
    made = 0
    with build_engine("td3", [0], environments=environments, changes=changes) as engine:
        for _ in engine.learn(40):
            if engine.updates:
                break
            made = engine.control_steps
    assert (made, build_settings("td3", **changes).first_update(environments)) == (first, first)


def test_indivisible_number_of_environments_is_refused():
    with pytest.raises(RequestError, match="3 environments can't share 5 updates every 10 control"):
        build_engine("ddpg", [0], environments=3)


@pytest.mark.parametrize("algo", ["ddpg", "td3"])
def test_action_noise_equals_stable_baselines3(algo):
    settings = build_settings(algo)
    agent = sb3.build(algo, settings, DummyVecEnv([lambda: sb3.Spaces(16, 3)]), 0)
    ours, theirs = ActionNoise(settings, (1, 1, 3)), agent.action_noise
    np.random.seed(6)
    normals = iter(np.random.normal(size=(100, 3)))
    np.random.seed(6)
    stream = SimpleNamespace(standard_normal=lambda shape: next(normals).reshape(shape))
    for number in range(100):
        drawn = ours.draw([SimpleNamespace(actions=stream)])
        np.testing.assert_allclose(drawn[0, 0], theirs(), rtol=1e-6)
        if number == 60:
            ours.reset(np.ones((1, 1), bool))
            theirs.reset()


def test_first_actions_of_ddpg_are_those_of_its_policy():
    changes = {"noise_sigma": 0.0, "noise_mean": 0.0, "learning_starts": 10_000}
    with build_engine("ddpg", [0], changes=changes) as engine:
        observation = engine.environments.observations[0].numpy()
        next(engine.learn(1))
        taken = float(engine.replay.rows_since(0, 0)[0, -1, -2])
        assert taken == pytest.approx(float(engine.policy(0).act(observation)[0, 0]), abs=1e-6)


def test_stored_actions_with_noise_are_within_the_limits():
    changes = {"noise_sigma": 5.0, "uniform_warmup": False, "learning_starts": 1000}
    with build_engine("td3", [0], changes=changes) as engine:
        list(engine.learn(LENGTH))
        actions = engine.replay.rows_since(0)[0, :LENGTH, -2]
    assert actions.abs().max() == 1
    # Noise with a standard deviation of 5 is within the limits in a sixth of the control steps.
    assert (actions.abs() == 1).sum() > LENGTH / 2


def test_each_motor_explores_by_itself():
    changes = {"learning_starts": 1000, "buffer_size": 1000, "train_freq": 10}
    for uniform, deviation in ((True, 3**-0.5), (False, 0.3)):
        warmup = {**changes, "uniform_warmup": uniform, "noise_sigma": 0.0 if uniform else 0.3}
        with build_engine("td3", [0], **CHEETAH, changes=warmup) as engine:
            list(engine.learn(10 * LENGTH))
            rows = engine.replay.rows_since(0)[0]
        # The last row of an episode has no action.
        actions = rows.view(10, LENGTH + 1, -1)[:, :-1, 17:-1].reshape(-1, 6).numpy()
        # Without correlation, the largest of 15 correlations of 200 samples is about 0.2.
        correlations = np.corrcoef(actions.T) - np.eye(6)
        assert abs(correlations).max() < 0.35
        assert actions.std(axis=0) == pytest.approx([deviation] * 6, rel=0.2)


def test_ppo_bootstraps_at_time_limit_unless_terminal():
    rewards = {}
    for limit in ("bootstrap", "terminal"):
        with build_engine("ppo", [0], changes={"n_steps": 100}, time_limit=limit) as engine:
            for ended in engine.learn(200):
                if ended is not None:
                    break
            rows = engine.state(0).tensors["loop/rollout"]
            rewards[limit] = rows[:, :, -1]
            learner = engine.learners[0]
    # The last observations of the episodes; the engine's robots have been reset since.
    plain = [RobotEnv("face_direction") for _ in range(2)]
    for env, generator in zip(plain, Generators(0, 2).environments, strict=True):
        env.np_random = generator
        env.reset()
    for step in range(LENGTH):
        last = [env.step(rows[e, step, -6:-5].numpy())[0] for e, env in enumerate(plain)]
    values = learner.value(torch.from_numpy(np.stack(last)))[:, 0]
    difference = rewards["bootstrap"] - rewards["terminal"]
    assert difference.shape == (2, LENGTH)
    assert not difference[:, :-1].any()
    torch.testing.assert_close(difference[:, -1], 0.99 * values, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("algo", "options"),
    [
        *((algo, {}) for algo in ALGORITHMS),
        slow("ppo", SCRIPTS["ppo"]),
        ("ddpg", {"ofe": FEW}),
        slow("sac", {"ofe": MANY}),
        ("ppo", CHEETAH),
        *(slow(algo, CHEETAH) for algo in ALGORITHMS if algo != "ppo"),
        ("sac", {**CHEETAH, "ofe": MANY}),
    ],
)
def test_extracted_policies_equal_agents(algo, options):
    with build_engine(algo, [0, 1, 2], **options) as engine:
        list(engine.learn(40))
        assert_policies_equal_agents(engine)


def test_actions_are_of_latest_policy():
    changes = {"noise_sigma": 0.0, "noise_mean": 0.0, "learning_starts": 0}
    with build_engine("ddpg", [0], changes=changes, stacked=True) as engine:
        observations = [engine.environments.observations[0, 0].clone()]
        policies = []
        for _ in engine.learn(LENGTH - 1):
            policies.append(engine.policy(0))
            observations.append(engine.environments.observations[0, 0].clone())
        actions = engine.replay.rows_since(0)[0, :, -2]
    # Updates follow every 10th step, so step 11 uses an updated policy.
    assert not np.array_equal(*(policies[step].linear_layers()[0].weight for step in (9, 10)))
    for step, policy in enumerate(policies):
        expected = policy.act(observations[step].numpy())
        assert float(actions[step]) == pytest.approx(float(expected[0]), abs=1e-6)


def test_out_of_memory_error_of_a_gpu_names_option(monkeypatch):
    def full(*_, **__):
        raise torch.OutOfMemoryError("CUDA out of memory.")

    monkeypatch.setattr("jbench.agents.batched.pair_buffer.ReplayBuffer", full)
    with pytest.raises(WorkError, match="replay buffers of 3 seeds: type fewer --seeds") as error:
        build_engine("ddpg", [0, 1, 2])
    assert "(in a matrix file, a key of [hyperparameters.ALGORITHM])" in str(error.value)


def test_replay_buffer_that_exceeds_the_memory_names_option():
    size = 10**13  # hundreds of terabytes
    with pytest.raises(WorkError, match=f"of 1 seed: type less than --set buffer_size={size} "):
        build_engine("td3", [0], changes={"buffer_size": size})
    with pytest.raises(WorkError, match="of 2 seeds: type fewer --seeds at a time, or less than"):
        build_engine("sac", [0, 1], changes={"buffer_size": size})


@pytest.mark.parametrize(
    ("shape", "library"),
    [
        ((10**13,), torch),
        ((10**13, 10**7), torch),  # a number of bytes of more than 64 bits
        ((10**13,), np),
    ],
)
def test_errors_of_too_little_memory_are_told_from_others(shape, library):
    settings = build_settings("ddpg")
    with pytest.raises((MemoryError, RuntimeError)) as too_large:
        library.zeros(shape)
    assert memory_error(too_large.value, settings, 1, "memory") is not None
    assert memory_error(too_large.value, build_settings("ppo"), 1, "memory") is None
    assert memory_error(RuntimeError("another"), settings, 1, "memory") is None
