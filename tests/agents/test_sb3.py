"""Tests of the settings, policies and losses of stable-baselines3 agents built by jbench."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.agents import sb3
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import ALGORITHMS, algorithm_settings
from jbench.tasks.gym import JitterbugEnv


def build(algo, **overrides):
    # The replay buffer of a million transitions is allocated lazily.
    settings = algorithm_settings(algo, overrides=overrides)
    environments = getattr(settings, "n_envs", 1)
    env = DummyVecEnv([lambda: JitterbugEnv("face_direction")] * environments)
    return sb3.build(algo, settings, env, seed=7)


def layers(module):
    return [
        (layer.in_features, layer.out_features)
        for layer in module.modules()
        if isinstance(layer, torch.nn.Linear)
    ]


NOISE = {"action_noise", "noise_mean", "noise_sigma", "noise_theta", "noise_dt"}
NAMED = {"hidden_layers", "uniform_warmup", "train_freq", "clip_range", "clip_range_vf"}


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_agents_have_the_settings(algo):
    settings, agent = algorithm_settings(algo), build(algo)
    for name, value in settings.model_dump(exclude=NOISE | NAMED).items():
        assert getattr(agent, name) == value, name
    critic = agent.policy.mlp_extractor.value_net if algo == "ppo" else agent.critic
    actor = agent.policy.mlp_extractor.policy_net if algo == "ppo" else agent.actor
    inner = [(16, 350), (350, 250)]
    outputs = {"ppo": [], "sac": [(250, 1)] * 2}.get(algo, [(250, 1)])
    assert layers(actor) == [*inner, *outputs]
    one = inner if algo == "ppo" else [(17, 350), *inner[1:], (250, 1)]
    assert layers(critic) == one * (2 if algo in ("td3", "sac") else 1)
    optimizers = [agent.policy.optimizer] if algo == "ppo" else [agent.actor.optimizer]
    for optimizer in optimizers:
        assert isinstance(optimizer, torch.optim.Adam)
        assert optimizer.param_groups[0]["lr"] == 1e-4
    if algo == "ppo":
        assert agent.clip_range(1.0) == agent.clip_range_vf(1.0) == 0.2
        return
    assert agent.train_freq == TrainFreq(settings.train_freq, TrainFrequencyUnit.STEP)
    noise = agent.action_noise
    assert (noise._mu, noise._sigma) == (settings.noise_mean, settings.noise_sigma)
    kind = OrnsteinUhlenbeckActionNoise if algo == "ddpg" else NormalActionNoise
    assert isinstance(noise, kind)
    if algo == "ddpg":
        assert (noise._theta, noise._dt) == (0.15, 0.01)


def test_ddpg_acts_by_its_policy_before_learning_starts():
    agent = build("ddpg", noise_sigma=0.0, noise_mean=0.0)
    agent._setup_learn(1000)
    action, _ = agent._sample_action(agent.learning_starts, agent.action_noise, 1)
    np.testing.assert_array_equal(action, agent.predict(agent._last_obs, deterministic=True)[0])


def test_td3_acts_uniformly_before_learning_starts():
    agent = build("td3", noise_sigma=0.0)
    agent._setup_learn(1000)
    actions = [agent._sample_action(10_000, agent.action_noise, 1)[0] for _ in range(200)]
    # The standard deviation of U(-1, 1) is 0.577; a policy would give one action.
    assert 0.5 < np.std(actions) < 0.65


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_saved_policy_equals_agent(algo):
    agent = build(algo, hidden_layers=[24, 16])
    observations = np.random.default_rng(0).normal(size=(50, 16)).astype(np.float32)
    expected, _ = agent.predict(observations, deterministic=True)
    policy = SavedNetwork.from_files(*sb3.copy_model(agent).files())
    np.testing.assert_allclose(policy.act(observations), expected, atol=2e-6)
    np.testing.assert_allclose(policy.act(observations[3]), expected[3], atol=2e-6)


def test_saved_policy_is_copy():
    agent = build("td3", hidden_layers=[4])
    policy = sb3.copy_model(agent)
    before = policy.layers[0].arrays["weight"].copy()
    with torch.no_grad():
        agent.actor.mu[0].weight += 1
    np.testing.assert_array_equal(policy.layers[0].arrays["weight"], before)


def test_losses_have_names_of_database():
    agent = build("sac", hidden_layers=[8], batch_size=8, learning_starts=8)
    assert sb3.losses(agent) == {}
    agent.learn(12, log_interval=None)
    losses = sb3.losses(agent)
    assert set(losses) == {"actor_loss", "critic_loss", "entropy_coefficient"}
    assert losses["entropy_coefficient"] == pytest.approx(1, abs=0.01)  # starts at 1
