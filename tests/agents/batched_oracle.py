"""stable-baselines3 agents as oracles of our learners, with parameters of the same names."""

import numpy as np
import torch
from stable_baselines3.common import policies
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

from jbench.agents import sb3
from jbench.agents.batched.learner import LOSS_SUMS
from jbench.agents.batched.make import own_learner
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


def build_oracle(algo, settings, dtype, monkeypatch, actions=1, size=SIZE):
    """An agent of stable-baselines3 that computes in the given precision."""
    # By default it converts observations to float32.
    monkeypatch.setattr(policies, "preprocess_obs", lambda observations, *_, **__: observations)
    env = DummyVecEnv([lambda: Spaces(size, actions)] * getattr(settings, "n_envs", 1))
    agent = sb3.build(algo, settings, env, seed=0)
    agent.policy.to(dtype)
    if getattr(agent, "log_ent_coef", None) is not None:
        agent.log_ent_coef.data = agent.log_ent_coef.data.to(dtype)
    if hasattr(agent, "ent_coef_tensor"):
        agent.ent_coef_tensor = torch.tensor(settings.ent_coef, dtype=dtype)
    buffer = agent.rollout_buffer if algo == "ppo" else agent.replay_buffer
    buffer.to_torch = lambda array, copy=True: torch.tensor(array, dtype=dtype)
    return agent


def build_learner(algo, settings, dtype=torch.float32, action_size=1, size=SIZE):
    """Returns the tensors of one seed, and its learner."""
    tensors = Tensors(1, dtype)
    return tensors, own_learner(algo)(settings, size, action_size, tensors.select(0))


def linear_layers(module):
    return [each for each in module.modules() if isinstance(each, nn.Linear)]


def _networks(algo, agent, learner):
    """The networks: a name, ours and the oracle's."""
    if algo == "ppo":
        policy, inner = agent.policy, agent.policy.mlp_extractor
        yield "actor", learner.actor, nn.ModuleList([inner.policy_net, policy.action_net])
        yield "critic", learner.critic, nn.ModuleList([inner.value_net, policy.value_net])
        return
    yield "actor", learner.actor, agent.actor
    if algo != "sac":
        yield "actor_target", learner.actor_target, agent.actor_target
    twins = algo != "ddpg"
    for suffix, critic in (("", agent.critic), ("_target", agent.critic_target)):
        critics = getattr(learner, f"critic{suffix}{'s' * twins}")
        networks = critics if twins else [critics]
        for i, pair in enumerate(zip(networks, critic.q_networks, strict=True)):
            yield f"critic{i}{suffix}", *pair


def parameters(algo, agent, learner):
    """Parameters by name: those of a seed, as writable views, and those of the oracle."""
    pairs = {}
    for name, network, module in _networks(algo, agent, learner):
        linear, inner = linear_layers(module), len(network.layers) - 1
        # The outputs of SAC's actor are two layers of the oracle.
        modules = [*([layer] for layer in linear[:inner]), linear[inner:]]
        for i, (ours, theirs) in enumerate(zip(network.layers, modules, strict=True)):
            weight, bias = (
                torch.cat([getattr(layer, kind).detach() for layer in theirs])
                for kind in ("weight", "bias")
            )
            pairs |= {
                f"{name} weight{i}": (ours.weight.mT, weight),
                f"{name} bias{i}": (ours.bias, bias),
            }
    if algo == "ppo":
        pairs["log_sigma"] = learner.log_sigma, agent.policy.log_std.detach()
    if algo == "sac" and agent.ent_coef_optimizer is not None:
        pairs["log_temperature"] = learner.log_temperature, agent.log_ent_coef.detach()
    return pairs


def copy_initial_parameters(algo, agent, learner):
    """Copies the initial parameters of an agent to a learner."""
    learner.initialize(torch.Generator().manual_seed(0))
    for ours, theirs in parameters(algo, agent, learner).values():
        ours.copy_(theirs)


def largest_difference(pairs):
    return max(float((ours.double() - theirs.double()).abs().max()) for ours, theirs in pairs)


def mean_losses(learner, tensors):
    """The mean of each recorded loss."""
    sums, counts = tensors.saved[LOSS_SUMS][0].unbind(dim=-1)
    return dict(zip(learner.losses, (sums / counts).tolist(), strict=True))


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
