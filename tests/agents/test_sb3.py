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

OFF_POLICY = ("ddpg", "sac", "td3")


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


@pytest.mark.parametrize("algo", OFF_POLICY)
def test_off_policy_agents_have_published_settings(algo):
    agent = build(algo)
    assert (agent.learning_rate, agent.batch_size, agent.gamma) == (1e-4, 256, 0.99)
    assert agent.buffer_size == agent.replay_buffer.buffer_size == 1_000_000
    assert agent.replay_buffer.handle_timeout_termination
    assert agent.n_envs == 1
    assert isinstance(agent.actor.optimizer, torch.optim.Adam)
    for optimizer in (agent.actor.optimizer, agent.critic.optimizer):
        (group,) = optimizer.param_groups
        assert (group["lr"], group["eps"], group["weight_decay"]) == (1e-4, 1e-8, 0)


def test_ddpg_has_published_settings():
    agent = build("ddpg")
    assert agent.train_freq == TrainFreq(100, TrainFrequencyUnit.STEP)
    assert (agent.gradient_steps, agent.tau, agent.learning_starts) == (50, 0.001, 256)
    noise = agent.action_noise
    assert isinstance(noise, OrnsteinUhlenbeckActionNoise)
    assert (noise._mu, noise._sigma, noise._theta, noise._dt) == (0.3, 0.3, 0.15, 0.01)
    # DDPG in stable-baselines3 is TD3 with one critic, no delay and no smoothing.
    assert (agent.policy_delay, agent.target_noise_clip) == (1, 0.0)
    assert layers(agent.actor) == [(16, 350), (350, 250), (250, 1)]
    assert layers(agent.critic) == [(17, 350), (350, 250), (250, 1)]


def test_td3_has_published_settings():
    agent = build("td3")
    assert agent.train_freq == TrainFreq(1000, TrainFrequencyUnit.STEP)
    assert (agent.gradient_steps, agent.tau, agent.learning_starts) == (1000, 0.005, 10_000)
    assert (agent.policy_delay, agent.target_policy_noise, agent.target_noise_clip) == (2, 0.2, 0.5)
    assert isinstance(agent.action_noise, NormalActionNoise)
    assert (agent.action_noise._mu, agent.action_noise._sigma) == (0.0, 0.2)
    assert layers(agent.critic) == 2 * [(17, 350), (350, 250), (250, 1)]


def test_sac_has_published_settings():
    agent = build("sac")
    assert agent.train_freq == TrainFreq(1, TrainFrequencyUnit.STEP)
    assert (agent.gradient_steps, agent.tau, agent.learning_starts) == (1, 0.005, 100)
    assert agent.target_entropy == -1.0
    assert agent.log_ent_coef.requires_grad
    assert agent.log_ent_coef.item() == 0.0
    assert agent.target_update_interval == 1
    assert isinstance(agent.action_noise, NormalActionNoise)
    assert layers(agent.actor) == [(16, 350), (350, 250), (250, 1), (250, 1)]


def test_ppo_has_published_settings():
    agent = build("ppo")
    assert (agent.n_envs, agent.n_steps, agent.batch_size, agent.n_epochs) == (8, 256, 512, 4)
    assert (agent.learning_rate, agent.gamma, agent.gae_lambda) == (1e-4, 0.99, 0.95)
    assert (agent.ent_coef, agent.vf_coef, agent.max_grad_norm) == (0.01, 0.5, 0.5)
    assert agent.clip_range(1.0) == agent.clip_range_vf(1.0) == 0.2
    assert agent.normalize_advantage
    net = agent.policy.mlp_extractor
    assert layers(net.policy_net) == layers(net.value_net) == [(16, 350), (350, 250)]
    assert isinstance(net.policy_net[1], torch.nn.ReLU)


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
