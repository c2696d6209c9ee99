"""Tests of update rules of other packages: updates, independent seeds and resuming."""

from typing import ClassVar

import numpy as np
import pytest
import torch
from torch import nn

from jbench.agents.batched.replay import Batch
from jbench.rules import TD3
from tests.agents.batched_oracle import PRECISION, SIZE, build_learner, build_settings, mean_losses
from tests.agents.small_rules import (
    TD3_SETTINGS,
    TQC,
    TQC_SETTINGS,
    batches,
    build_engine,
    learners,
)
from tests.agents.test_batched_engine import (
    BETWEEN_EPISODES,
    CHEETAH,
    STEPS,
    assert_continues,
    assert_independent,
    assert_loads,
    assert_policies_equal_agents,
    slow,
)
from tests.agents.test_plain_updates import assert_equal_parameters, copy_parameters, paired_layers
from tests.matrices import diagonal


@pytest.mark.parametrize(("dtype", "actions"), diagonal([*PRECISION], (1, 6)), ids=str)
def test_td3_rule_equals_builtin_td3(dtype, actions):
    settings = build_settings("td3")
    own_tensors, own = build_learner("td3", settings, dtype, action_size=actions)
    tensors, (learner,), _ = learners(TD3, settings, dtype, actions=actions)
    own.initialize(torch.Generator().manual_seed(3))
    learner.rule.critic_targets = learner.rule.critics_target
    layers = [*paired_layers("td3", own, learner.rule)]
    copy_parameters(layers)
    first = own.actor.values.clone()
    for update, numbers in enumerate(batches(learner, 100, dtype), 1):
        for updated in (own, learner):
            delayed = updated.is_delayed_update(update, 0)
            updated.reset_losses([delayed])
            updated.update(Batch(*(part.clone() for part in numbers), actions), delayed)
        if update in (1, 10, 100):
            assert_equal_parameters(layers, PRECISION[dtype])
            if update > 1:
                expected = pytest.approx(mean_losses(own, own_tensors), rel=1e-4)
                assert mean_losses(learner, tensors) == expected
    assert (own.actor.values - first).abs().max() > 0.01


@pytest.mark.parametrize("actions", [1, 6])
@pytest.mark.parametrize(("rule", "settings"), [(TD3, TD3_SETTINGS), (TQC, TQC_SETTINGS)])
def test_stacked_updates_equal_those_of_single_seeds(rule, settings, actions):
    (alone, each, _), (together, _, stack) = (
        learners(rule, settings, torch.float64, 3, actions) for _ in range(2)
    )
    assert not torch.equal(alone.saved["rule.actor"][0], alone.saved["rule.actor"][1])
    for update, numbers in enumerate(batches(stack, 6, seeds=(3,)), 1):
        delayed = stack.is_delayed_update(update, 0)
        for seed, learner in enumerate(each):
            learner.update(Batch(*(part[seed] for part in numbers), actions), delayed)
        stack.update(Batch(*numbers, actions), delayed)
    assert alone.saved.keys() == together.saved.keys()
    for name, saved in alone.saved.items():
        torch.testing.assert_close(together.saved[name], saved, rtol=0, atol=1e-10)
    seen = torch.randn(3, 5, SIZE, dtype=torch.float64)
    expected = [learner.act(seen[seed]) for seed, learner in enumerate(each)]
    torch.testing.assert_close(stack.act(seen), torch.stack(expected))


SEVERAL = {"environments": 2, "time_limit": "terminal"}


@pytest.mark.parametrize(
    ("rule", "settings", "options"),
    [
        (TD3, TD3_SETTINGS, SEVERAL),
        slow(TQC, TQC_SETTINGS, CHEETAH),
        slow(TD3, TD3_SETTINGS, {}),
        slow(TQC, TQC_SETTINGS, SEVERAL),
    ],
)
def test_seed_is_independent_of_other_seeds_bit_for_bit(rule, settings, options):
    steps = BETWEEN_EPISODES if "task" in options else STEPS
    assert_independent(lambda seeds: build_engine(rule, settings, seeds, **options), steps)


def test_policy_of_rule_moves_all_motors():
    with build_engine(TQC, TQC_SETTINGS, [3, 4], **CHEETAH) as engine:
        actions = assert_policies_equal_agents(engine)
    assert np.ptp(actions, axis=-1).min() > 0


@pytest.mark.parametrize(
    ("rule", "settings", "stacked"),
    [
        (TD3, TD3_SETTINGS, True),
        slow(TQC, TQC_SETTINGS, False),
        slow(TD3, TD3_SETTINGS, False),
        slow(TQC, TQC_SETTINGS, True),
    ],
)
def test_restored_engine_continues_bit_for_bit(rule, settings, stacked):
    assert_continues(lambda seeds: build_engine(rule, settings, seeds, stacked=stacked), 37)


@pytest.mark.parametrize(("rule", "settings"), [(TD3, TD3_SETTINGS), (TQC, TQC_SETTINGS)])
def test_loaded_policy_equals_agent_bit_for_bit(rule, settings):
    assert_loads(lambda seeds: build_engine(rule, settings, seeds))


class Unusual(TD3):
    """Has an actor with layers without biases, and a learned number without axes."""

    losses: ClassVar[dict[str, str]] = {**TD3.losses, "scale_loss": "scale"}

    def __init__(self, settings, observation_size):
        super().__init__(settings, observation_size)
        layers = nn.Linear(observation_size, 8, bias=False), nn.LayerNorm(8, bias=False)
        self.actor = nn.Sequential(*layers, nn.ReLU(), nn.Linear(8, 1))
        self.scale = nn.Parameter(torch.tensor(0.5))

    def scale_loss(self, batch):
        return (self.scale - 1).square()


@pytest.mark.parametrize("stacked", [False, True])
def test_rule_with_layers_without_bias_and_number_without_axes_is_trained(stacked):
    with (
        build_engine(Unusual, TD3_SETTINGS, [0, 1], stacked=stacked) as engine,
        build_engine(Unusual, TD3_SETTINGS, [9]) as other,
    ):
        list(engine.learn(60))
        scales = engine.state(1).tensors["agent/rule.scale"]
        kept = engine.policy(1)
        other.load_policy(0, kept, 60)
        loaded = other.policy(0)
    assert scales.tolist() == [pytest.approx(0.5 + 20 * 1e-3, rel=1e-3)] + [0] * 15
    assert loaded.files() == kept.files()
