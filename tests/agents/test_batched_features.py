"""Tests of features learned with an agent: gradients, updates, statistics and predictions."""

from functools import partial

import pytest
import torch

from jbench.agents.batched.layers import affine_views
from jbench.agents.batched.make import on_features
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.tensors import Tensors
from jbench.settings.records import OFESettings
from tests.agents.batched_oracle import SIZE, build_settings, mean_losses
from tests.agents.plain_ofe import PlainDDPGOnFeatures, PlainFeatures
from tests.agents.test_batched_engine import build_engine
from tests.agents.test_plain_updates import (
    ACTIONS,
    assert_equal_parameters,
    copy_parameters,
    paired_layers,
    transitions,
)
from tests.matrices import diagonal

# As many units as observed numbers replace the observation, and more extend it.
SIZES = [
    OFESettings(units=units, layers=3, standardize_updates=4, learning_rate=1e-3)
    for units in (SIZE, SIZE + 1)
]


def build_learner(algo, ofe, *, stacked=False, actions=1, **changes):
    """A learner of one seed, or of a stack of two seeds with the same parameters."""
    tensors = Tensors(2 if stacked else 1, torch.float64)
    make = partial(on_features(algo, ofe), build_settings(algo, **changes), SIZE, actions)
    each = [make(tensors.select(seed)) for seed in range(tensors.seeds)]
    for learner in each:
        learner.initialize(torch.Generator().manual_seed(1))
    if not stacked:
        return each[0], each[0]
    return make(tensors), each[1]


def twice(batch):
    """Returns the same minibatch for each of two seeds."""
    parts = batch.rows, batch.next_rows, batch.discounts, batch.noise
    both = (part.expand(2, *part.shape).clone() for part in parts)
    return Batch(*both, batch.actions.shape[-1])


@pytest.mark.parametrize(("ofe", "stacked", "actions"), diagonal(SIZES, (False, True), ACTIONS))
def test_updates_of_ddpg_and_features_equal_autograd(ofe, stacked, actions):
    learner, seed = build_learner("ddpg", ofe, stacked=stacked, actions=actions)
    plain = PlainDDPGOnFeatures(build_settings("ddpg"), ofe, SIZE, actions)
    random = torch.Generator().manual_seed(2)
    features = learner.features
    layers = [
        *paired_layers("ddpg", seed, plain),
        *zip(seed.features.layers, plain.features.linear_layers(), strict=True),
    ]
    copy_parameters(layers)
    for _ in range(10):
        batch = transitions(random, actions)
        loss = plain.update(batch)
        learner.reset_losses([True])
        learner.update(twice(batch) if stacked else batch)
        recorded = mean_losses(learner, learner.view)["prediction_loss"]
        assert recorded == pytest.approx(loss, abs=1e-10)
        # Adam hides the size of a gradient.
        flat = features.gradient[1] if stacked else features.gradient
        gradients = affine_views(flat, features.shapes)
        for ours, theirs in zip(gradients, plain.features.linear_layers(), strict=True):
            torch.testing.assert_close(ours.weight.mT, theirs.weight.grad, rtol=0, atol=1e-10)
            torch.testing.assert_close(ours.bias, theirs.bias.grad, rtol=0, atol=1e-10)
    assert_equal_parameters(layers)


@pytest.mark.parametrize("ofe", SIZES)
@pytest.mark.parametrize("actions", ACTIONS)
@pytest.mark.parametrize("algo", ["td3", "sac"])
def test_twin_critics_share_features_and_differentiate_through_them(algo, ofe, actions):
    learner, _ = build_learner(algo, ofe, actions=actions)
    plain = PlainFeatures(ofe, SIZE, actions)
    copy_parameters(zip(learner.features.layers, plain.linear_layers(), strict=True))
    size = learner.features.size
    pairs = torch.randn(9, size + actions, dtype=torch.float64)
    taken = pairs[:, size:].clone().requires_grad_()
    seen = plain.state_action_features(pairs[:, :size], taken)
    first, _ = learner.critics
    for critic in learner.critics:
        value = critic.forward(pairs)
        expected = seen
        for i, layer in enumerate(critic.layers):
            expected = (expected.relu() if i else expected) @ layer.weight + layer.bias
        torch.testing.assert_close(value, expected.detach(), rtol=0, atol=1e-10)
        if algo == "sac" or critic is first:
            rows = None if algo == "td3" else torch.tensor([1, 4, 7])
            (gradient,) = torch.autograd.grad(expected.sum(), taken, retain_graph=True)
            gradient = gradient if rows is None else gradient[rows]
            delta = torch.ones(len(gradient), 1, dtype=torch.float64)
            ours = critic.action_gradient(delta, rows)
            torch.testing.assert_close(ours, gradient, rtol=0, atol=1e-10)


def test_units_are_divided_among_layers():
    assert OFESettings(units=240).widths == [40] * 6
    assert OFESettings(units=12).widths == [2] * 6
    assert OFESettings(units=14).widths == [3, 3, 2, 2, 2, 2]
    assert OFESettings(units=3).widths == [1] * 3


def test_losses_are_means_over_the_newest_learning_phase():
    ofe = OFESettings(units=12, pretraining=0.0)
    changes = {"uniform_warmup": False, "learning_starts": 100, "train_freq": 50}
    changes |= {"gradient_steps": 24}
    with build_engine("td3", [0], changes=changes, ofe=ofe) as engine:
        for _ in engine.learn(250):  # two phases of 24 updates, of which 12 are the actor's
            pass
        counts = engine.state(0).tensors["agent/losses"][:, 1].tolist()
        assert dict(zip(engine.learners[0].losses, counts, strict=True)) == {
            "actor_loss": 12,
            "critic_loss": 24,
            "prediction_loss": 24,
        }


@pytest.mark.slow
def test_features_learn_in_pretraining_and_training():
    ofe = OFESettings(units=12, learning_rate=3e-3, pretraining=2.0, standardize_updates=50)
    losses = []
    # The learning rate is so small that only the features change.
    changes = {"uniform_warmup": False, "noise_sigma": 1.0, "learning_rate": 1e-8}
    changes |= {"learning_starts": 100, "train_freq": 50, "gradient_steps": 25}
    for pretraining in (0.0, 2.0):
        its = ofe.model_copy(update={"pretraining": pretraining})
        with build_engine("td3", [0], changes=changes, ofe=its, episode_steps=60) as engine:
            for _ in engine.learn(400):
                losses.append(engine.losses(0).get("prediction_loss"))
    without, pretrained = losses[:400], losses[400:]
    # The first updates follow 150 control steps and, with pretraining, 300 updates of the features.
    assert without[149] is pretrained[149] is None
    assert pretrained[150] < 0.6 * without[150]
    assert without[-1] < 0.9 * without[150]
