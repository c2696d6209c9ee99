"""Tests of the documented TQC rule, against sb3-contrib."""

import pytest
import sb3_contrib
import torch
from stable_baselines3.common import policies
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

from jbench.tasks.gym import JitterbugEnv
from tests.agents.batched_oracle import fill, mean_losses, next_batch, transitions
from tests.agents.small_rules import TQC, TQC_SETTINGS, learners


def build_tqc(settings, dtype, monkeypatch):
    """sb3-contrib's TQC with the settings of the documented rule."""
    monkeypatch.setattr(policies, "preprocess_obs", lambda observations, *_, **__: observations)
    layers = list(settings.hidden_layers)
    agent = sb3_contrib.TQC(
        "MlpPolicy",
        DummyVecEnv([lambda: JitterbugEnv("face_direction")]),
        policy_kwargs={
            "net_arch": layers,
            "n_critics": settings.critics,
            "n_quantiles": settings.quantiles,
        },
        top_quantiles_to_drop_per_net=settings.dropped,
        learning_rate=settings.learning_rate,
        buffer_size=500,
        batch_size=settings.batch_size,
        tau=settings.tau,
        gamma=settings.gamma,
        seed=0,
        device="cpu",
    )
    agent.set_logger(Logger(folder=None, output_formats=[]))
    agent.policy.to(dtype)
    agent.log_ent_coef.data = torch.full((1,), -0.7, dtype=dtype)
    agent.replay_buffer.to_torch = lambda array, copy=True: torch.tensor(array, dtype=dtype)
    return agent


def tqc_parameters(agent):
    """Parameters of sb3-contrib's TQC by the names of the documented rule."""
    actor = [m for m in agent.actor.latent_pi if isinstance(m, nn.Linear)]
    heads = agent.actor.mu, agent.actor.log_std
    named = {}
    for kind in ("weight", "bias"):
        for i, module in enumerate(actor):
            named[f"actor.{2 * i}.{kind}"] = getattr(module, kind)
        joined = torch.cat([getattr(head, kind) for head in heads])
        named[f"actor.{2 * len(actor)}.{kind}"] = joined
    for name, critic in (("critics", agent.critic), ("critics_target", agent.critic_target)):
        for number, network in enumerate(critic.q_networks):
            named |= {f"{name}.{number}.{key}": v for key, v in network.named_parameters()}
    return {name: values.detach() for name, values in named.items()}


def test_documented_tqc_equals_sb3_contrib(monkeypatch):
    dtype, settings = torch.float64, TQC_SETTINGS
    agent, data = build_tqc(settings, dtype, monkeypatch), transitions()
    fill(agent, data)
    tensors, (learner,), _ = learners(TQC, settings, dtype)
    for name, values in tqc_parameters(agent).items():
        learner._parameters[name].copy_(values)
    for update in range(1, 21):
        # sb3-contrib updates the entropy coefficient before the actor, the rule after it.
        learner._parameters["log_alpha"].copy_(agent.log_ent_coef.detach())
        batch = next_batch(data, settings, 2, dtype, update)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        learner.reset_losses([True])
        learner.update(batch)
        recorded = agent.logger.name_to_value
        assert mean_losses(learner, tensors) == pytest.approx(
            {name: recorded[f"train/{name}"] for name in ("critic_loss", "actor_loss")}, rel=1e-6
        )
    for name, values in tqc_parameters(agent).items():
        torch.testing.assert_close(learner._parameters[name], values, rtol=0, atol=1e-7, msg=name)
