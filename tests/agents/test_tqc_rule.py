"""Tests of the documented TQC rule, against sb3-contrib."""

import pytest
import torch

from jbench.agents import sb3
from jbench.settings.algorithms import Foreign
from tests.agents.batched_oracle import (
    build_oracle,
    fill,
    linear_layers,
    mean_losses,
    next_batch,
    transitions,
)
from tests.agents.small_rules import TQC, TQC_SETTINGS, learners


def paired_parameters(rule, agent):
    """Pairs of parameters of the documented rule and of sb3-contrib's TQC."""
    *inner, mean, deviation = linear_layers(agent.actor)
    for kind in ("weight", "bias"):
        ours = [getattr(layer, kind) for layer in linear_layers(rule.actor)]
        *theirs, first, second = (getattr(layer, kind) for layer in (*inner, mean, deviation))
        yield from zip(ours, (*theirs, torch.cat([first, second])), strict=True)
    for ours, theirs in ((rule.critics, agent.critic), (rule.critics_target, agent.critic_target)):
        yield from zip(ours.parameters(), theirs.parameters(), strict=True)


def test_documented_tqc_equals_sb3_contrib(monkeypatch):
    dtype, settings, data = torch.float64, TQC_SETTINGS, transitions()
    network = {"net_arch": list(settings.hidden_layers), "n_critics": settings.critics}
    network["n_quantiles"] = settings.quantiles
    same = settings.model_dump(include={"learning_rate", "batch_size", "tau", "gamma"})
    more = {"top_quantiles_to_drop_per_net": settings.dropped, "buffer_size": len(data[0])}
    theirs = {**same, **more, "policy_kwargs": network}
    foreign = Foreign(hyperparameters=theirs)
    agent = build_oracle("sb3_contrib:TQC", foreign, dtype, monkeypatch)
    agent.log_ent_coef.data.fill_(-0.7)
    fill(agent, data)
    tensors, (learner,), _ = learners(TQC, settings, dtype)
    for ours, theirs in paired_parameters(learner.rule, agent):
        ours.data.copy_(theirs.data)
    for update in range(1, 21):
        # sb3-contrib updates the entropy coefficient before the actor, the rule after it.
        learner._parameters["log_alpha"].copy_(agent.log_ent_coef.detach())
        batch = next_batch(data, settings, 2, dtype, update)
        agent.train(gradient_steps=1, batch_size=settings.batch_size)
        learner.reset_losses([True])
        learner.update(batch)
        expected = sb3.losses(agent)
        del expected["entropy_coefficient"]
        assert mean_losses(learner, tensors) == pytest.approx(expected, rel=1e-6)
    for ours, theirs in paired_parameters(learner.rule, agent):
        torch.testing.assert_close(ours.data, theirs.data, rtol=0, atol=1e-7)
