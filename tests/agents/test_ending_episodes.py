"""Tests of agents whose episodes end early, each at its own control step."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.buffers import ReplayBuffer, RolloutBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from jbench.agents.batched.make import make_batched_engine
from jbench.agents.batched.on_policy import write_advantages
from jbench.agents.batched.pair_buffer import PairBuffer
from jbench.agents.batched.ppo import Transitions
from jbench.agents.batched.replay import Batch, Sizes
from jbench.agents.ending_environments import environments_class
from jbench.agents.sb3 import Spaces
from jbench.settings.algorithms import algorithm_settings
from jbench.tasks.find import find_task
from tests.agents.batched_oracle import (
    SIZE,
    TRANSITIONS,
    build_learner,
    build_oracle,
    build_settings,
    copy_initial_parameters,
    largest_difference,
    parameters,
    transitions,
)

LEAVES = "tests.gym_tasks:leaves"
SMALL = {"hidden_layers": [8], "batch_size": 8, "learning_starts": 20, "train_freq": 10}


def made_ends(count, shape=()):
    """Returns random terminations and truncations (count, ...), which exclude each other."""
    random = np.random.default_rng(8)
    terminated = random.uniform(size=(count, *shape)) < 0.2
    return terminated, ~terminated & (random.uniform(size=(count, *shape)) < 0.2)


def fill_both(theirs, ours, data):
    """Adds the same transitions to stable-baselines3's buffer and to ours, as engines do."""
    observations, actions, rewards, next_observations, _ = data
    terminated, truncated = made_ends(len(rewards))
    for i in range(len(rewards)):
        info = {"TimeLimit.truncated": bool(truncated[i])}
        done = np.array([terminated[i] or truncated[i]])
        steps = observations[i], next_observations[i], actions[i], rewards[i]
        theirs.add(*steps, done, [info])
        ours.begin(torch.from_numpy(observations[i, None, None]))
        ours.add(
            actions[i, None, None],
            rewards[i, None, None],
            torch.from_numpy(next_observations[i, None, None]),
        )
        ours.end(np.array([[terminated[i]]]))
        if i % 7 == 6:
            ours.flush()
    ours.flush()


def sampled(buffer, updates=1, size=32, seed=0):
    """Returns places in a ring, and the minibatch of them as rows and discounts."""
    drawn = buffer.sample(np.random.default_rng(seed), updates, size)
    rows, next_rows, terminal = (part[0] for part in drawn)
    stored = buffer.seed_rows(range(1))
    return rows // 2, stored[rows], stored[next_rows], torch.from_numpy(terminal)


@pytest.mark.parametrize("algo", ["td3", "sac"])
@pytest.mark.parametrize("capacity", [TRANSITIONS, 70])
def test_update_with_ended_episodes_equals_stable_baselines3(algo, capacity, monkeypatch):
    settings = build_settings(algo, buffer_size=capacity)
    agent = build_oracle(algo, settings, torch.float64, monkeypatch)
    theirs = ReplayBuffer(capacity, *_spaces(), device="cpu", handle_timeout_termination=True)
    theirs.to_torch = lambda array, copy=True: torch.tensor(array, dtype=torch.float64)
    ours = PairBuffer(Sizes(1, 1, capacity, SIZE, 1), flush_every=7, dtype=torch.float64)
    fill_both(theirs, ours, transitions())
    _, learner = build_learner(algo, settings, torch.float64)
    copy_initial_parameters(algo, agent, learner)

    places, rows, next_rows, terminal = sampled(ours)
    known = theirs._get_samples(places)
    assert isinstance(known, ReplayBufferSamples)
    assert 0 < terminal.sum() < len(terminal)
    assert torch.equal(known.dones[:, 0] == 1, terminal)
    torch.manual_seed(3)
    noise = torch.empty(len(rows), learner.noise_per_transition, dtype=torch.float64)
    for column in range(noise.shape[1]):
        noise[:, column] = torch.empty(len(rows), 1, dtype=torch.float64).normal_()[:, 0]
    torch.manual_seed(3)
    agent.replay_buffer.sample = lambda *_, **__: known
    agent.train(gradient_steps=1, batch_size=len(rows))
    discounts = settings.gamma * (1 - terminal[:, None].double())
    batch = Batch(rows.clone(), next_rows.clone(), discounts, noise)
    learner.update(batch, learner.is_delayed_update(1, 0))
    assert largest_difference(parameters(algo, agent, learner).values()) < 1e-10


def _spaces():
    env = Spaces(SIZE, 1)
    return env.observation_space, env.action_space


@pytest.mark.parametrize("environments", [1, 3])
@pytest.mark.parametrize("steps", [1, 19, 20, 21, 150])
def test_buffer_has_the_last_transitions_and_their_ends(steps, environments):
    shape, capacity = (2, environments), 20
    sizes = Sizes(*shape, capacity * environments, 3, 2)
    buffer = PairBuffer(sizes, flush_every=5)
    random = np.random.default_rng(0)
    terminated, truncated = made_ends(steps, shape)
    past = []
    seen = random.normal(size=(*shape, 3)).astype(np.float32)
    buffer.begin(torch.from_numpy(seen))
    for step in range(steps):
        actions, rewards = random.normal(size=(*shape, 2)), random.normal(size=shape)
        following = random.normal(size=(*shape, 3)).astype(np.float32)
        buffer.add(actions, rewards, torch.from_numpy(following))
        parts = seen, actions, rewards[..., None], following, terminated[step, ..., None]
        past.append(np.concatenate(parts, axis=-1).astype(np.float32))
        ended = terminated[step] | truncated[step]
        seen = following.copy()
        seen[ended] = random.normal(size=(ended.sum(), 3))
        if ended.any():
            buffer.end(terminated[step])
            buffer.begin(torch.from_numpy(seen))
        if step % 5 == 4:
            buffer.flush()
    buffer.flush()
    for seed in range(2):
        draws = buffer.sample(np.random.default_rng(1), 2, 2000, seed)
        rows, next_rows, terminal = (part.reshape(-1) for part in draws)
        stored = buffer.seed_rows(range(seed, seed + 1)).numpy()
        found = [stored[rows], stored[next_rows][:, :3], terminal[:, None]]
        kept = np.concatenate([each[seed] for each in past[-capacity:]])
        assert {*map(tuple, np.concatenate(found, axis=1))} == {*map(tuple, kept)}

    restored = PairBuffer(sizes, flush_every=5)
    for seed in range(2):
        restored.restore(seed, buffer.rows_since(seed), buffer.row)
        for one, other in zip(
            restored.sample(np.random.default_rng(1), 2, 50, seed),
            buffer.sample(np.random.default_rng(1), 2, 50, seed),
            strict=True,
        ):
            np.testing.assert_array_equal(one, other)
    assert torch.equal(restored.seed_rows(range(2)), buffer.seed_rows(range(2)))


def test_advantages_where_environments_end_at_different_steps():
    settings = algorithm_settings("ppo", "published", {"gamma": 0.5, "gae_lambda": 0.8})
    # Environment 0 ends with its second step, environment 1 does not end.
    ends = np.array([[[False, True, False], [False, False, False]]])
    values = torch.tensor([[[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]])
    rewards = torch.tensor([[[4.0, 5.0, 6.0], [4.0, 5.0, 6.0]]])
    rollout = Transitions(torch.zeros(1, 2, 3, Transitions.width(1, 1)), action_size=1)
    rollout.values[..., 0] = values
    rollout.rewards[..., 0] = rewards
    write_advantages(rollout, ends, torch.tensor([[10.0, 10.0]]), settings)
    # Last step: 6 + 0.5 * 10 - 3 = 8. Second: 5 - 2 = 3, or 5 + 0.5 * 3 - 2 + 0.4 * 8 = 7.7.
    # First: 4 + 0.5 * 2 - 1 = 4, and 0.4 times the advantage of the second.
    expected = [[[5.2, 3.0, 8.0], [7.08, 7.7, 8.0]]]
    advantages = rollout.advantages[..., 0]
    np.testing.assert_allclose(advantages, expected, rtol=1e-6)
    returns = rollout.returns[..., 0]
    np.testing.assert_allclose(returns, np.array(expected) + values.numpy(), rtol=1e-6)

    buffer = RolloutBuffer(3, *_spaces(), gae_lambda=0.8, gamma=0.5, n_envs=2)
    buffer.values, buffer.rewards = (part[0].T.numpy() for part in (values, rewards))
    buffer.episode_starts = np.array([[0, 0], [0, 0], [1, 0]], np.float32)
    buffer.compute_returns_and_advantage(torch.tensor([10.0, 10.0]), np.zeros(2))
    np.testing.assert_allclose(buffer.advantages.T[None], advantages, rtol=1e-6)


def build_engine(algo, changes, seeds=(0,), count=1, **options):
    settings = algorithm_settings(algo, "suite", changes)
    robots = environments_class(LEAVES)(LEAVES, seeds, count)
    return make_batched_engine(algo, settings, robots, **options)


def test_missing_rewards_are_added_where_an_episode_is_truncated():
    """PPO: gamma V of the last observation joins the reward at the time limit, not at a fall."""
    about = {"hidden_layers": [8], "n_envs": 3, "n_steps": 60, "batch_size": 60}
    rewards, ends = {}, []
    for limit in ("bootstrap", "terminal"):
        with build_engine("ppo", about, count=3, time_limit=limit) as engine:
            for step, ended in enumerate(engine.learn(3 * 59)):
                if ended is not None and limit == "bootstrap":
                    ends.append((step, ended))
                if step == 58:  # the last one before an update, after which the rollout is empty
                    break
            rewards[limit] = engine.state(0).tensors["loop/rollout"][..., -1]
    added = (rewards["bootstrap"] - rewards["terminal"]).numpy()
    truncated = np.zeros_like(added, bool)
    terminated = truncated.copy()
    for step, ended in ends:
        terminated[:, step] = ended.terminated[0]
        truncated[:, step] = ended.ended[0] & ~ended.terminated[0]
        assert (ended.lengths[0][truncated[:, step]] == 20).all()
    assert truncated.any()
    assert terminated.any()
    assert (added[truncated] != 0).all()
    assert (added[~truncated] == 0).all()


def test_terminal_time_limit_concerns_truncations_only():
    """Off-policy agents: an end that is terminal has no value of what follows."""
    terminal, ended, fallen = {}, [], []
    changes = {**SMALL, "learning_starts": 1000, "buffer_size": 200}
    for limit in ("bootstrap", "terminal"):
        with build_engine("td3", changes, time_limit=limit) as engine:
            for ends in engine.learn(100):
                if ends is not None and limit == "bootstrap":
                    ended.append(engine.control_steps - 1)
                    fallen += ended[-1:] if ends.terminated[0, 0] else []
            rows = engine.replay.rows_since(0)[0].view(100, 2, -1)
        terminal[limit] = np.flatnonzero(rows[:, 1, -1].numpy() == 1).tolist()
    assert 0 < len(fallen) < len(ended)
    assert terminal == {"bootstrap": fallen, "terminal": ended}


def test_replay_has_the_last_observation_of_each_episode():
    changes = {**SMALL, "learning_starts": 1000, "buffer_size": 200}
    with build_engine("td3", changes) as engine:
        ends = {}
        for ended in engine.learn(100):
            if ended is not None:
                ends[engine.control_steps - 1] = bool(ended.terminated[0, 0])
        rows = engine.replay.rows_since(0)[0].view(100, 2, -1)
    size = find_task(LEAVES).observation_size
    terminal = rows[:, 1, -1] == 1
    assert np.flatnonzero(terminal.numpy()).tolist() == [t for t, fell in ends.items() if fell]
    # A cart has left the rail in the last observation of an episode, and only there.
    assert torch.equal(rows[:, 1, 0].abs() > 1, terminal)
    follows = torch.tensor([t not in ends for t in range(99)])
    assert torch.equal((rows[:-1, 1, :size] == rows[1:, 0, :size]).all(dim=1), follows)
