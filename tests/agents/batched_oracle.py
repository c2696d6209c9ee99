"""stable-baselines3 agents as oracles of our learners, with parameters of the same names."""

import numpy as np
import torch
from stable_baselines3.common import policies
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

from jbench.agents import sb3
from jbench.agents.batched.learner import LOSS_SUMS
from jbench.agents.batched.make import LEARNERS
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.tensors import Tensors
from jbench.agents.sb3 import Spaces
from jbench.settings.algorithms import algorithm_settings

SIZE = 16  # of an observation of face_direction
TRANSITIONS = 500
# Bound of the difference of parameters after 1, 10 and 100 updates with a learning rate of 1e-3.
# Parameters are of the order of 0.1, so 1e-6 is a few times the rounding of float32.
PRECISION = {torch.float64: 1e-10, torch.float32: 2e-6}


def build_settings(algo, **overrides):
    """Settings with small networks and a larger learning rate."""
    small = {"hidden_layers": [24, 20], "batch_size": 32, "learning_rate": 1e-3}
    small |= {} if algo == "ppo" else {"buffer_size": TRANSITIONS}
    return algorithm_settings(algo, overrides=small | overrides)


def build_oracle(algo, settings, dtype, monkeypatch, actions=1):
    """An agent of stable-baselines3 that computes in the given precision."""
    # By default it converts observations to float32.
    monkeypatch.setattr(policies, "preprocess_obs", lambda observations, *_, **__: observations)
    env = DummyVecEnv([lambda: Spaces(SIZE, actions)] * getattr(settings, "n_envs", 1))
    agent = sb3.build(algo, settings, env, seed=0)
    agent.policy.to(dtype)
    if getattr(agent, "log_ent_coef", None) is not None:
        agent.log_ent_coef.data = agent.log_ent_coef.data.to(dtype)
    if hasattr(agent, "ent_coef_tensor"):
        agent.ent_coef_tensor = torch.tensor(settings.ent_coef, dtype=dtype)
    buffer = agent.rollout_buffer if algo == "ppo" else agent.replay_buffer
    buffer.to_torch = lambda array, copy=True: torch.tensor(array, dtype=dtype)
    return agent


def build_learners(algo, settings, dtype=torch.float32, seeds=1, action_size=1):
    """Returns the tensors of some seeds, a learner per seed, and a learner of the stack."""
    tensors = Tensors(seeds, dtype)
    views = [tensors, *(tensors.select(seed) for seed in range(seeds))]
    stack, *each = (LEARNERS[algo](settings, SIZE, action_size, view) for view in views)
    return tensors, each, stack


def theirs(algo, agent):
    """Parameters of a stable-baselines3 agent by name."""
    parameters = {
        f"{name} {kind}{i}": torch.cat([getattr(module, kind).detach() for module in modules])
        for name, layers in _networks(algo, agent).items()
        for i, modules in enumerate(layers)
        for kind in ("weight", "bias")
    }
    if algo == "ppo":
        parameters["log_sigma"] = agent.policy.log_std.detach()
    if algo == "sac" and agent.ent_coef_optimizer is not None:
        parameters["log_temperature"] = agent.log_ent_coef.detach()
    return parameters


def _networks(algo, agent):
    """The oracle's networks by our names: the linear modules of each layer."""

    def layers(modules, *heads):
        inner = [[module] for module in modules if isinstance(module, nn.Linear)]
        return inner + ([list(heads)] if heads else [])

    if algo == "ppo":
        net = agent.policy
        return {
            "actor": layers(net.mlp_extractor.policy_net, net.action_net),
            "critic": layers(net.mlp_extractor.value_net, net.value_net),
        }
    critics = ["critic"] if algo == "ddpg" else ["critic1", "critic2"]
    tensors_by_name = {
        name: layers(q) for name, q in zip(critics, agent.critic.q_networks, strict=True)
    }
    for name, q in zip(critics, agent.critic_target.q_networks, strict=True):
        tensors_by_name[f"{name}_target"] = layers(q)
    if algo == "sac":
        actor = agent.actor
        return tensors_by_name | {"actor": layers(actor.latent_pi, actor.mu, actor.log_std)}
    return tensors_by_name | {
        "actor": layers(agent.actor.mu),
        "actor_target": layers(agent.actor_target.mu),
    }


def ours(algo, learner):
    """Parameters of a seed by the names of `theirs`, as writable views."""
    networks = {"actor": learner.actor}
    if algo in ("td3", "sac"):
        for suffix, twins in (("", learner.critics), ("_target", learner.critic_targets)):
            networks |= {f"critic{i}{suffix}": net for i, net in enumerate(twins.networks, 1)}
    else:
        networks["critic"] = learner.critic
    for name in ("actor_target", "critic_target"):
        if hasattr(learner, name):
            networks[name] = getattr(learner, name)
    parameters = {
        f"{name} {kind}{i}": values
        for name, network in networks.items()
        for i, (weight, bias) in enumerate(network.layers)
        for kind, values in (("weight", weight.mT), ("bias", bias))
    }
    if algo == "ppo":
        parameters["log_sigma"] = learner.log_sigma
    if algo == "sac" and learner.settings.ent_coef == "auto":
        parameters["log_temperature"] = learner.log_temperature
    return parameters


def copy_initial_parameters(algo, agent, learner):
    """Copies the initial parameters of an agent to a learner."""
    learner.initialize(torch.Generator().manual_seed(0))
    mine = ours(algo, learner)
    for name, value in theirs(algo, agent).items():
        mine[name].copy_(value)


def mean_losses(learner, tensors):
    """The mean of each recorded loss."""
    sums, counts = tensors.saved[LOSS_SUMS][0].unbind(dim=-1)
    return dict(zip(learner.losses, (sums / counts).tolist(), strict=True))


def largest_difference(mine, their):
    """The largest difference of tensors with the same names."""
    assert mine.keys() == their.keys()
    return max(float((mine[name].double() - their[name].double()).abs().max()) for name in mine)


def transitions(actions=1):
    """Random observations, actions, rewards, next observations (float32) and ends."""
    random = np.random.default_rng(1)
    observations, next_observations = random.normal(size=(2, TRANSITIONS, SIZE)).astype(np.float32)
    taken = random.uniform(-1, 1, (TRANSITIONS, actions)).astype(np.float32)
    rewards = random.uniform(0, 1, TRANSITIONS).astype(np.float32)
    return observations, taken, rewards, next_observations, random.uniform(size=TRANSITIONS) < 0.1


def fill(agent, data):
    """Adds transitions to an agent's replay buffer."""
    for observation, action, reward, next_observations, end in zip(*data, strict=True):
        agent.replay_buffer.add(observation, next_observations, action, reward, end, [{}])


def next_batch(data, settings, draws, dtype, update):
    """Returns the batch that the agent samples next, and seeds its random numbers."""
    size, shape = settings.batch_size, (settings.batch_size, data[1].shape[1])

    def set_seeds():
        np.random.seed(update)
        torch.manual_seed(update)

    set_seeds()
    indices = np.random.randint(0, TRANSITIONS, size=size)
    noise = [torch.empty(shape, dtype=dtype).normal_() for _ in range(draws // shape[1])]
    set_seeds()
    observations, actions, rewards, next_observations, ends = (
        torch.as_tensor(part[indices]).to(dtype) for part in data
    )
    return Batch(
        torch.cat([observations, actions, rewards[:, None]], dim=1),
        torch.cat([next_observations, torch.zeros(size, shape[1] + 1, dtype=dtype)], dim=1),
        settings.gamma * (1 - ends[:, None]),
        torch.cat([torch.empty(size, 0, dtype=dtype), *noise], dim=1),
        shape[1],
    )
