"""Tests of the update rules, against stable-baselines3."""

import numpy as np
import pytest
import torch

from jbench.agents import sb3
from jbench.agents.batched.on_policy import write_advantages
from jbench.agents.batched.ppo import Transitions
from tests.agents import batched_oracle as oracle
from tests.agents.test_batched_engine import slow
from tests.matrices import diagonal

OFF_POLICY = ("ddpg", "td3", "sac")
LARGE_NOISE = {"target_policy_noise": 0.9, "target_noise_clip": 0.8}
PPO_CASES = [
    (1, 120, {}),
    (5, 60, {}),
    (25, 30, {"learning_rate": 3e-4}),
    # The last minibatch of an epoch is smaller.
    (3, 50, {"clip_range_vf": None}),
    (3, 50, {"normalize_advantage": False, "vf_coef": 0.1, "max_grad_norm": 0.05}),
    (3, 40, {"ent_coef": 0.0, "clip_range": 0.05}),
]
"""Epochs, size of a minibatch, and other settings."""


def update_both(agent, learner, tensors, settings, updates):
    """Updates agent and learner on the same batches; yields after each update."""
    dtype, data = tensors.dtype, oracle.transitions(learner.action_size)
    oracle.fill(agent, data)
    for update in range(1, updates + 1):
        batch = oracle.next_batch(data, settings, learner.noise_per_transition, dtype, update)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        delayed = learner.is_delayed_update(update, 0)
        learner.reset_losses([delayed])
        learner.update(batch, delayed)
        yield update


@pytest.mark.parametrize(
    ("algo", "changes", "dtype", "actions", "updates"),
    [
        ("ddpg", {}, torch.float64, 1, 100),
        ("td3", {}, torch.float64, 6, 100),
        ("sac", {}, torch.float64, 6, 100),
        slow("ddpg", {}, torch.float64, 6, 100),
        *(slow(algo, {}, torch.float64, 1, 100) for algo in OFF_POLICY if algo != "ddpg"),
        *(slow(algo, {}, torch.float32, 1, 100) for algo in OFF_POLICY),
        ("ddpg", {"hidden_layers": [16]}, torch.float64, 1, 10),
        ("ddpg", {"hidden_layers": [20, 9, 12], "tau": 0.5, "gamma": 0.5}, torch.float64, 1, 10),
        ("td3", {"policy_delay": 3, **LARGE_NOISE}, torch.float64, 1, 10),
        ("sac", {"ent_coef": 0.3}, torch.float64, 1, 10),
        ("sac", {"tau": 1.0}, torch.float64, 1, 10),
    ],
)
def test_off_policy_updates_equal_stable_baselines3(
    algo, changes, dtype, actions, updates, monkeypatch
):
    # In both, the target entropy of SAC is minus the size of an action.
    automatic = {"target_entropy": "auto"} if algo == "sac" else {}
    settings = oracle.build_settings(algo, **automatic, **changes)
    agent = oracle.build_oracle(algo, settings, dtype, monkeypatch, actions)
    tensors, learner = oracle.build_learner(algo, settings, dtype, action_size=actions)
    oracle.copy_initial_parameters(algo, agent, learner)
    for update in update_both(agent, learner, tensors, settings, updates):
        if update in (1, 10, 100):
            pairs = oracle.parameters(algo, agent, learner).values()
            assert oracle.largest_difference(pairs) < oracle.PRECISION[dtype]
    assert oracle.mean_losses(learner, tensors) == pytest.approx(sb3.losses(agent), rel=1e-5)


def test_sac_target_update_interval_counts_from_each_learning_phase():
    settings = oracle.build_settings("sac", target_update_interval=3, gradient_steps=5)
    tensors, learner = oracle.build_learner("sac", settings, torch.float64)
    delayed = [learner.is_delayed_update(7 + i, i) for i in range(5)]
    assert delayed == [True, False, False, True, False]
    learner.initialize(torch.Generator().manual_seed(0))
    first = {name: saved.clone() for name, saved in tensors.saved.items()}
    learner.update(
        oracle.next_batch(oracle.transitions(), settings, 2, torch.float64, 1), delayed=False
    )
    kept = {name for name, saved in tensors.saved.items() if torch.equal(saved, first[name])}
    assert kept == {"critic1_target", "critic2_target"}


def fill_rollout(agent, settings, data):
    """Fills an agent's rollout buffer; returns the same transitions as our rollout."""
    buffer, random = agent.rollout_buffer, np.random.default_rng(5)
    shape = (settings.n_steps, settings.n_envs)
    buffer.reset()
    observations, actions, rewards, *_ = (part[: shape[0] * shape[1]] for part in data)
    buffer.observations = observations.reshape(*shape, oracle.SIZE)
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
    rollout = Transitions(rows, actions.shape[-1])
    last = torch.tensor([[0.3, -0.2]])
    write_advantages(rollout, ends, last, settings)
    buffer.compute_returns_and_advantage(last, np.full(2, ends[-1]))
    return rollout


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch")
@pytest.mark.parametrize(
    ("case", "actions", "dtype"), diagonal(PPO_CASES, (1, 6), [*oracle.PRECISION]), ids=str
)
def test_ppo_updates_equal_stable_baselines3(case, actions, dtype, monkeypatch):
    epochs, batch_size, changes = case
    changes = {"n_envs": 2, "n_steps": 60, "n_epochs": epochs, "batch_size": batch_size} | changes
    settings = oracle.build_settings("ppo", **changes)
    agent = oracle.build_oracle("ppo", settings, dtype, monkeypatch, actions)
    tensors, learner = oracle.build_learner("ppo", settings, dtype, action_size=actions)
    oracle.copy_initial_parameters("ppo", agent, learner)
    rollout = fill_rollout(agent, settings, oracle.transitions(actions))
    rows = rollout.rows.flatten(0, 2).to(dtype)
    np.random.seed(3)
    agent.train()
    np.random.seed(3)
    for _ in range(epochs):
        order = torch.from_numpy(np.random.permutation(120))
        for indices in order.split(batch_size):
            learner.update(Transitions(rows[indices], actions))
    pairs = oracle.parameters("ppo", agent, learner).values()
    assert oracle.largest_difference(pairs) < oracle.PRECISION[dtype]
    assert oracle.mean_losses(learner, tensors) == pytest.approx(
        sb3.losses(agent), rel=1e-4, abs=1e-7
    )


def test_advantages_equal_stable_baselines3_bit_for_bit(monkeypatch):
    settings = oracle.build_settings("ppo", n_envs=2, n_steps=200, batch_size=100, gae_lambda=0.8)
    agent = oracle.build_oracle("ppo", settings, torch.float32, monkeypatch)
    rollout = fill_rollout(agent, settings, oracle.transitions())
    buffer = agent.rollout_buffer
    np.testing.assert_array_equal(rollout.advantages[0, ..., 0].numpy().T, buffer.advantages)
    np.testing.assert_array_equal(rollout.returns[0, ..., 0].numpy().T, buffer.returns)


@pytest.mark.parametrize("actions", [1, 6])
@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac", "ppo"])
def test_actions_equal_stable_baselines3(algo, actions, monkeypatch):
    settings = oracle.build_settings(algo, **({"n_envs": 1} if algo == "ppo" else {}))
    agent = oracle.build_oracle(algo, settings, torch.float64, monkeypatch, actions)
    _, learner = oracle.build_learner(algo, settings, torch.float64, action_size=actions)
    oracle.copy_initial_parameters(algo, agent, learner)
    observations = torch.from_numpy(oracle.transitions()[0][:40]).double()
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


@pytest.mark.parametrize("algo", ["ddpg", "td3", "sac", "ppo"])
def test_initial_weights_are_distributed_as_in_stable_baselines3(algo, monkeypatch):
    settings = oracle.build_settings(algo, hidden_layers=[200, 100])
    agent = oracle.build_oracle(algo, settings, torch.float32, monkeypatch)
    _, learner = oracle.build_learner(algo, settings)
    learner.initialize(torch.Generator().manual_seed(0))
    pairs = oracle.parameters(algo, agent, learner)
    for ours, theirs in pairs.values():
        if theirs.numel() > 90:
            assert ours.std().item() == pytest.approx(theirs.std().item(), rel=0.2)
            assert ours.abs().max().item() == pytest.approx(theirs.abs().max().item(), rel=0.3)
    for name, (ours, _) in pairs.items():
        if "target" in name:
            assert torch.equal(ours, pairs[name.replace("_target", "")][0])
