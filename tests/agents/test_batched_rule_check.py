"""Tests that faulty update rules are refused before training."""

import pytest
import torch
from torch import nn

from jbench.agents.batched.make import checked_rule
from jbench.errors import RequestError, WorkError
from jbench.policies.copied_modules import UnsupportedPolicyError
from jbench.rules import TD3
from tests.agents.batched_oracle import SIZE
from tests.agents.small_rules import TD3_SETTINGS, build_engine


def changed(**attributes):
    """TD3 with other attributes."""
    return type("Faulty", (TD3,), attributes)


def with_actor(*layers):
    class Faulty(TD3):
        def __init__(self, settings, observation_size):
            super().__init__(settings, observation_size)
            self.actor = nn.Sequential(*layers)

    return Faulty


class WithBatchNorm(TD3):
    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.normalization = nn.BatchNorm1d(observation_size)

    def actor_loss(self, batch):
        return self.normalization(batch.observations).mean() + super().actor_loss(batch)


def with_dropout(self, batch):
    return nn.functional.dropout(batch.rewards).mean() + TD3.actor_loss(self, batch)


def failing(self, batch):
    raise AssertionError


def loss_on_part(self, batch):
    return TD3.critic_loss(self, batch) + batch.rewards[batch.rewards >= 0].mean()


class WithRandomBuffer(TD3):
    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.register_buffer("projection", torch.randn(observation_size, 4))


class WithSharedModule(TD3):
    targets = ("critics",)
    delayed = ()

    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.trunk = nn.Linear(observation_size, 8)
        self.actor = nn.Sequential(self.trunk, nn.Linear(8, 1))


class WithSharedParameter(TD3):
    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        self.critics[1][0].weight = self.critics[0][0].weight  # within one attribute, it may be
        self.critics[1][2].bias = self.actor[2].bias


def in_place(self, batch):
    batch.rewards.mul_(2)
    return TD3.critic_loss(self, batch)


def replaced(self, batch):
    batch.rewards = 2 * batch.rewards
    return TD3.critic_loss(self, batch)


def replaced_twice(self, batch):
    batch.rewards = 2 * batch.rewards
    batch.rewards = batch.rewards / 2  # may lie where the first ones lay
    return TD3.critic_loss(self, batch)


def extended(self, batch):
    batch.rewards_of_before = batch.rewards
    return TD3.critic_loss(self, batch)


FIRST, LAST = nn.Linear(SIZE, 8), nn.Linear(8, 1)


@pytest.mark.parametrize(
    ("rule", "sentence"),
    [
        (changed(losses={}), "it has no losses"),
        (
            changed(losses={"loss": "actor"}),
            "it has no method loss, or no network or parameter act",
        ),
        (changed(losses={"actor_loss": "policy"}), "or no network or parameter policy"),
        (changed(targets=("critic",)), "has no critic, which is among its targets"),
        (changed(delayed=("critic",)), "critic is delayed, but neither trained nor a target"),
        (with_actor(FIRST, nn.Tanh()), "its actor is no nn.Sequential that ends in a Linear layer"),
        (with_actor(), "its actor is no nn.Sequential that ends in a Linear layer"),
        (WithRandomBuffer, "its buffer projection is random, but seeds share buffers"),
        (WithSharedModule, "trunk is the module actor.0; each must have its own"),
        (
            changed(explore=lambda self, observations, noise: self.act(observations)[:, 0]),
            r"fails \(explore returns \(16,\) numbers, not actions \(16, 1\)",
        ),
        (
            changed(actor_loss=lambda self, batch: self.act(batch.observations)[:, 0]),
            r"seeds fails \(actor_loss returns 16 numbers, not one\)",
        ),
        (changed(actor_loss=with_dropout), r"seeds fails \(.*random"),
        (WithBatchNorm, r"seeds fails \(Batch norm got a batched tensor .* updated in place"),
        (
            changed(actor_loss=lambda self, batch: batch.rewards.mean()),
            r"seeds fails \(.*does not require grad",
        ),
        (
            changed(critic_loss=lambda self, batch: None),
            r"seeds fails \(critic_loss returns None, which is no tensor\)",
        ),
        (changed(critic_loss=in_place), r"seeds fails \(a loss changes the batch"),
        (changed(critic_loss=replaced), r"seeds fails \(a loss changes the batch"),
        (changed(critic_loss=replaced_twice), r"seeds fails \(a loss changes the batch"),
        (changed(critic_loss=extended), r"seeds fails \(a loss changes the batch"),
        (changed(critic_loss=failing), r"seeds fails \(AssertionError, line \d+ of test_batched"),
        (changed(losses=["critic_loss"]), "its losses are no mapping"),
        (changed(targets="actor"), r"are the text 'actor'; type a tuple, \('actor',\)"),
        (changed(delayed="actor"), r"its delayed is the text 'actor'; type a tuple"),
        (changed(gradients_first=("acto_loss",)), "acto_loss is in gradients_first, but it has no"),
        (changed(act=lambda self, seen: self.actor(seen)), "it has its own act, but the saved pol"),
        (WithSharedParameter, r"critics.1.2.bias is the parameter actor.2.bias; each must"),
        (changed(critic_loss=loss_on_part), "seeds fails"),
        (
            changed(explore=lambda self, seen, noise: self.act(seen) if noise.sum() > 0 else noise),
            "seeds fails",
        ),
    ],
)
def test_faulty_rule_is_refused_before_training(rule, sentence):
    with pytest.raises(WorkError, match=f"[Tt]he rule {rule.__name__} .*{sentence}"):
        build_engine(rule, TD3_SETTINGS, [0])


def test_policy_that_cannot_be_saved_is_refused_before_training():
    with pytest.raises(UnsupportedPolicyError, match="softsign"):
        build_engine(with_actor(FIRST, nn.Softsign(), LAST), TD3_SETTINGS, [0])


class WithOneOutput(TD3):
    def __init__(self, settings, observation_size, action_size):
        super().__init__(settings, observation_size, action_size)
        self.actor = nn.Sequential(nn.Linear(observation_size, 1))


class ByName(TD3):
    def __init__(self, settings, observation_size, *, action_size):
        super().__init__(settings, observation_size, action_size)


class OfAnyArguments(TD3):
    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **named)


class ByPosition(TD3):
    def __init__(self, *arguments):
        super().__init__(*arguments)


class Forgetful(TD3):
    def __init__(self, settings, observation_size, action_size):
        super().__init__(settings, observation_size)


def test_rule_for_one_action_is_refused_for_six():
    rule = with_actor(FIRST, LAST)
    assert checked_rule(rule, TD3_SETTINGS, SIZE, 1).action_size == 1
    for taking in (ByName, OfAnyArguments, ByPosition):
        for actions in (1, 6):
            assert checked_rule(taking, TD3_SETTINGS, SIZE, actions).action_size == actions
    with pytest.raises(RequestError, match="Faulty is for tasks with one action, and this t"):
        checked_rule(rule, TD3_SETTINGS, SIZE, 6)
    for rule, sentence in (
        (WithOneOutput, "its actor has 1 outputs, and an action has 6 numbers"),
        (Forgetful, "its __init__ does not pass action_size on to Rule.__init__"),
    ):
        with pytest.raises(WorkError, match=f"The rule {rule.__name__} .*{sentence}"):
            checked_rule(rule, TD3_SETTINGS, SIZE, 6)
