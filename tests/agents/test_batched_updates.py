"""Tests of the update rules, against stable-baselines3."""

import numpy as np
import pytest
import torch

from jbench.agents import sb3
from jbench.agents.batched.on_policy import estimate
from jbench.agents.batched.ppo import split_minibatch
from jbench.agents.batched.replay import Batch
from jbench.settings.bases import SCRIPT
from tests.agents.batched_oracle import (
    PRECISION,
    SIZE,
    build_learners,
    build_oracle,
    build_settings,
    copy_initial_parameters,
    fill,
    largest_difference,
    mean_losses,
    next_batch,
    ours,
    theirs,
    transitions,
)
from tests.agents.test_batched_engine import slow

OFF_POLICY = ("ddpg", "td3", "sac")
PRECISIONS = pytest.mark.parametrize("dtype", PRECISION, ids=str)


def update_both(agent, learner, tensors, settings, updates):
    """Updates agent and learner on the same batches; yields after each update."""
    dtype, data = tensors.dtype, transitions(learner.action_size)
    fill(agent, data)
    for update in range(1, updates + 1):
        batch = next_batch(data, settings, learner.noise_per_transition, dtype, update)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        delayed = learner.is_delayed_update(update, 0)
        learner.reset_losses([delayed])
        learner.update(batch, delayed)
        yield update


@pytest.mark.parametrize(
    ("algo", "changes", "dtype", "actions", "updates"),
    [
        *((algo, {}, torch.float64, size, 100) for algo in OFF_POLICY for size in (1, 6)),
        *(slow(algo, {}, torch.float32, 1, 100) for algo in ("ddpg", "td3")),
        ("sac", {}, torch.float32, 1, 100),
        ("ddpg", {"hidden_layers": [16]}, torch.float64, 1, 10),
        ("ddpg", {"hidden_layers": [20, 9, 12], "tau": 0.5, "gamma": 0.5}, torch.float64, 1, 10),
        ("td3", {"policy_delay": 3, "target_policy_noise": 0.9}, torch.float64, 1, 10),
        ("sac", {"ent_coef": 0.3}, torch.float64, 1, 10),
        ("sac", {"tau": 1.0}, torch.float64, 1, 10),
    ],
)
def test_off_policy_updates_equal_stable_baselines3(
    algo, changes, dtype, actions, updates, monkeypatch
):
    # In both, the target entropy of SAC is minus the size of an action.
    automatic = {"target_entropy": "auto"} if algo == "sac" else {}
    settings = build_settings(algo, **automatic, **changes)
    agent = build_oracle(algo, settings, dtype, monkeypatch, actions)
    tensors, (learner,), _ = build_learners(algo, settings, dtype, action_size=actions)
    copy_initial_parameters(algo, agent, learner)
    for update in update_both(agent, learner, tensors, settings, updates):
        if update in (1, 10, 100):
            mine, their = ours(algo, learner), theirs(algo, agent)
            assert largest_difference(mine, their) < PRECISION[dtype]
    assert mean_losses(learner, tensors) == pytest.approx(sb3.losses(agent), rel=1e-5)


def test_sac_target_update_interval_counts_from_each_learning_phase():
    settings = build_settings("sac", target_update_interval=3, gradient_steps=5)
    _, (learner,), _ = build_learners("sac", settings, torch.float64)
    delayed = [learner.is_delayed_update(7 + i, i) for i in range(5)]
    assert delayed == [True, False, False, True, False]
    learner.initialize(torch.Generator().manual_seed(0))
    first = {name: value.clone() for name, value in ours("sac", learner).items()}
    learner.update(next_batch(transitions(), settings, 2, torch.float64, 1), delayed=False)
    for name, value in ours("sac", learner).items():
        assert torch.equal(value, first[name]) == ("target" in name), name


def fill_rollout(agent, settings, data):
    """Fills an agent's rollout buffer; returns the same transitions as rows of our rollout."""
    buffer, random = agent.rollout_buffer, np.random.default_rng(5)
    shape = (settings.n_steps, settings.n_envs)
    buffer.reset()
    observations, actions, rewards, *_ = (part[: shape[0] * shape[1]] for part in data)
    buffer.observations = observations.reshape(*shape, SIZE)
    buffer.actions = actions.reshape(*shape, -1)
    buffer.rewards = rewards.reshape(shape)
    buffer.values = random.normal(size=shape).astype(np.float32)
    buffer.log_probs = random.normal(-1, 0.3, shape).astype(np.float32)
    ends = random.uniform(size=shape[0]) < 0.1
    buffer.episode_starts[1:] = ends[:-1, None]
    buffer.pos, buffer.full = shape[0], True
    likelihoods_and_values = np.stack([buffer.log_probs, buffer.values], axis=-1)
    unknown = np.zeros((*shape, 2), np.float32)  # advantages and returns
    parts = [buffer.observations, buffer.actions, likelihoods_and_values, unknown]
    joined = np.concatenate([*parts, buffer.rewards[..., None]], axis=-1)
    rows = torch.from_numpy(joined.swapaxes(0, 1)[None].astype(np.float32))
    last = torch.tensor([[0.3, -0.2]])
    estimate(rows, ends, last, settings)
    buffer.compute_returns_and_advantage(last, np.full(2, ends[-1]))
    return rows


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch")
@PRECISIONS
@pytest.mark.parametrize("actions", [1, 6])
@pytest.mark.parametrize(
    ("epochs", "batch_size", "changes"),
    [
        (1, 120, {}),
        (5, 60, {}),
        (25, 30, {"learning_rate": 3e-4}),
        # The last minibatch of an epoch is smaller.
        (3, 50, {"clip_range_vf": None}),
        (3, 50, {"normalize_advantage": False, "vf_coef": 0.1, "max_grad_norm": 0.05}),
        (3, 40, {"ent_coef": 0.0, "clip_range": 0.05}),
    ],
)
def test_ppo_updates_equal_stable_baselines3(
    epochs, batch_size, changes, actions, dtype, monkeypatch
):
    changes = {"n_envs": 2, "n_steps": 60, "n_epochs": epochs, "batch_size": batch_size} | changes
    settings = build_settings("ppo", **changes)
    agent = build_oracle("ppo", settings, dtype, monkeypatch, actions)
    tensors, (learner,), _ = build_learners("ppo", settings, dtype, action_size=actions)
    copy_initial_parameters("ppo", agent, learner)
    rollout = fill_rollout(agent, settings, transitions(actions))
    rows = rollout.flatten(0, 2).to(dtype)
    np.random.seed(3)
    agent.train()
    np.random.seed(3)
    for _ in range(epochs):
        order = torch.from_numpy(np.random.permutation(120))
        for indices in order.split(batch_size):
            learner.update(split_minibatch(rows[indices], actions))
    assert largest_difference(ours("ppo", learner), theirs("ppo", agent)) < (PRECISION[dtype])
    assert mean_losses(learner, tensors) == pytest.approx(sb3.losses(agent), rel=1e-4, abs=1e-7)


def test_advantages_equal_stable_baselines3_bit_for_bit(monkeypatch):
    settings = build_settings("ppo", n_envs=2, n_steps=200, batch_size=100)
    agent = build_oracle("ppo", settings, torch.float32, monkeypatch)
    rollout = fill_rollout(agent, settings, transitions())
    buffer = agent.rollout_buffer
    for column, expected in ((-3, buffer.advantages), (-2, buffer.returns)):
        np.testing.assert_array_equal(rollout[0, :, :, column].numpy().T, expected)


@pytest.mark.parametrize("actions", [1, 6])
@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac", "ppo"])
def test_actions_equal_stable_baselines3(algo, actions, monkeypatch):
    settings = build_settings(algo, **({"n_envs": 1} if algo == "ppo" else {}))
    agent = build_oracle(algo, settings, torch.float64, monkeypatch, actions)
    _, (learner,), _ = build_learners(algo, settings, torch.float64, action_size=actions)
    copy_initial_parameters(algo, agent, learner)
    observations = torch.from_numpy(transitions()[0][:40]).double()
    acting = agent.policy if algo == "ppo" else agent.actor
    expected = acting._predict(observations, deterministic=True).detach()
    torch.testing.assert_close(learner.act(observations), expected.clamp(-1, 1))
    torch.manual_seed(4)
    noise = torch.empty(40, actions, dtype=torch.float64).normal_()
    torch.manual_seed(4)
    if algo == "ppo":
        with torch.no_grad():
            expected = torch.cat([part.view(40, -1) for part in agent.policy(observations)[::2]], 1)
            value = agent.policy.predict_values(observations)
        torch.testing.assert_close(learner.explore(observations, noise)[:, :-1], expected)
        torch.testing.assert_close(learner.explore(observations, noise)[:, -1:], value)
    elif learner.is_stochastic:
        expected = agent.actor._predict(observations, deterministic=False).detach()
        torch.testing.assert_close(learner.explore(observations, noise), expected)


@pytest.mark.parametrize("actions", [1, 6])
@pytest.mark.parametrize(
    ("algo", "changes"),
    [*((algo, {}) for algo in ("ddpg", "td3", "sac", "ppo")), *SCRIPT.items()],
)
def test_stacked_updates_equal_those_of_single_seeds(algo, changes, actions):
    settings = build_settings(algo, **changes)
    (alone, each, _), (together, _, stack) = (
        build_learners(algo, settings, torch.float64, 3, actions) for _ in range(2)
    )
    for seed, learner in enumerate(each):
        learner.initialize(torch.Generator().manual_seed(seed))
    for name, saved in alone.saved.items():
        together.saved[name].copy_(saved)
    random = torch.Generator().manual_seed(1)

    def numbers(width):
        return torch.randn(3, 20, width, generator=random, dtype=torch.float64)

    for update in range(1, 6):
        if algo == "ppo":
            rows = numbers(SIZE + actions + 5)
            stack.update(split_minibatch(rows, actions))
            for seed, learner in enumerate(each):
                learner.update(split_minibatch(rows[seed], actions))
            continue
        delayed, draws = stack.is_delayed_update(update, update - 1), stack.noise_per_transition
        width = SIZE + actions + 1
        parts = (numbers(width), numbers(width), numbers(1), numbers(draws))
        for seed, learner in enumerate(each):
            learner.update(Batch(*(part[seed].clone() for part in parts), actions), delayed)
        stack.update(Batch(*parts, actions), delayed)
    for name, saved in alone.saved.items():
        torch.testing.assert_close(together.saved[name], saved, rtol=0, atol=1e-10)


@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac", "ppo"])
def test_initial_weights_are_distributed_as_in_stable_baselines3(algo, monkeypatch):
    settings = build_settings(algo, hidden_layers=[200, 100])
    agent = build_oracle(algo, settings, torch.float32, monkeypatch)
    _, (learner,), _ = build_learners(algo, settings)
    learner.initialize(torch.Generator().manual_seed(0))
    mine, their = ours(algo, learner), theirs(algo, agent)
    for name, value in their.items():
        if value.numel() > 90:
            assert mine[name].std().item() == pytest.approx(value.std().item(), rel=0.2)
            assert mine[name].abs().max().item() == pytest.approx(value.abs().max().item(), rel=0.3)
    for name in mine:
        if "target" in name:
            assert torch.equal(mine[name], mine[name.replace("_target", "")])
