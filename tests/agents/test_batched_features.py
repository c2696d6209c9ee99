"""Features that are learned with an agent: gradients, updates, statistics, and what they learn."""

import pytest
import torch

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.rules import ON_FEATURES
from jbench.agents.batched.tensors import Tensors
from jbench.settings.ofe import OFESettings
from tests.agents.batched_oracle import SIZE, settings_of
from tests.agents.plain_ofe import PlainDDPGOnFeatures, PlainFeatures
from tests.agents.test_batched_engine import engine_of
from tests.agents.test_plain_updates import assert_alike, ddpg_layers, start_alike, transitions

SIZES = {
    "alone": OFESettings(units=12, layers=3, standardize_updates=4, learning_rate=1e-3),
    "appended": OFESettings(units=20, layers=3, standardize_updates=4, learning_rate=1e-3),
}
sizes = pytest.mark.parametrize("ofe", SIZES.values(), ids=SIZES)
UPDATES = 10


def learner_of(algo, ofe, *, stacked=False, **changes):
    """A learner of one seed, or of a stack of two whose first numbers are the same."""
    tensors = Tensors(2 if stacked else 1, torch.float64)
    make = ON_FEATURES[algo]
    each = [
        make(settings_of(algo, **changes), SIZE, tensors.of(seed), ofe=ofe)
        for seed in range(tensors.seeds)
    ]
    for learner in each:
        learner.initialize(torch.Generator().manual_seed(1))
    if not stacked:
        return each[0], each[0]
    return make(settings_of(algo, **changes), SIZE, tensors.all(), ofe=ofe), each[1]


def of_a_stack(batch):
    """The same minibatch for each of two seeds."""
    parts = batch.rows, batch.next_rows, batch.discounts, batch.noise
    return Batch(*(part.expand(2, *part.shape).clone() for part in parts))


def feature_layers(features, plain):
    yield from zip(features.layers, plain.linear_layers(), strict=True)


@sizes
@pytest.mark.parametrize("stacked", [False, True])
def test_gradients_and_updates_of_features_are_those_of_autograd(ofe, stacked):
    learner, seed = learner_of("td3", ofe, stacked=stacked)
    plain, random = PlainFeatures(ofe, SIZE), torch.Generator().manual_seed(2)
    start_alike(feature_layers(seed.features, plain))
    for _ in range(UPDATES):
        batch = transitions(random)
        loss = float(plain.loss(batch).detach()) if len(plain.first) >= 4 else None
        gradients = plain.learn(batch)
        errors = learner.features.learn(of_a_stack(batch) if stacked else batch)
        flat = learner.features.gradient[1] if stacked else learner.features.gradient
        for ours, (weight, bias) in zip(seed.features.layers_of(flat), gradients, strict=True):
            torch.testing.assert_close(ours.weight.mT, weight, rtol=0, atol=1e-10)
            torch.testing.assert_close(ours.bias, bias, rtol=0, atol=1e-10)
        assert loss is None or float(errors.mean()) == pytest.approx(loss, abs=1e-10)
        assert_alike(feature_layers(seed.features, plain))


@sizes
@pytest.mark.parametrize("stacked", [False, True])
def test_updates_of_ddpg_on_features_are_those_of_autograd(ofe, stacked):
    learner, seed = learner_of("ddpg", ofe, stacked=stacked)
    plain = PlainDDPGOnFeatures(settings_of("ddpg"), ofe, SIZE)
    random = torch.Generator().manual_seed(2)
    layers = [*ddpg_layers(seed, plain), *feature_layers(seed.features, plain.features)]
    start_alike(layers)
    for _ in range(UPDATES):
        batch = transitions(random)
        plain.update(batch)
        learner.update(of_a_stack(batch) if stacked else batch)
    assert_alike(layers)


@sizes
@pytest.mark.parametrize("algo", ["td3", "sac"])
def test_twin_critics_see_the_same_features_and_differentiate_through_them(algo, ofe):
    learner, _ = learner_of(algo, ofe)
    plain = PlainFeatures(ofe, SIZE)
    start_alike(feature_layers(learner.features, plain))
    pairs = torch.randn(9, learner.features.size + 1, dtype=torch.float64)
    actions = pairs[:, -1:].clone().requires_grad_()
    seen = plain.of_pairs(pairs[:, :-1], actions)
    rows = torch.tensor([1, 4, 7])
    values, gradients = [], []
    for critic in learner.critics:
        value = critic.forward(pairs)
        its_rows = None if algo == "td3" else rows
        delta = torch.ones(9 if its_rows is None else 3, 1, dtype=torch.float64)
        if algo == "sac" or critic is learner.critics[0]:
            gradients.append((its_rows, critic.action_gradient(delta, its_rows)))
        values.append(value)
    for place, (critic, value) in enumerate(zip(learner.critics, values, strict=True)):
        wanted = seen
        for i, layer in enumerate(critic.layers):
            wanted = (wanted.relu() if i else wanted) @ layer.weight + layer.bias
        torch.testing.assert_close(value, wanted.detach(), rtol=0, atol=1e-10)
        if place < len(gradients):
            its_rows, gradient = gradients[place]
            (by_actions,) = torch.autograd.grad(wanted.sum(), actions, retain_graph=True)
            by_actions = by_actions if its_rows is None else by_actions[its_rows]
            torch.testing.assert_close(gradient, by_actions, rtol=0, atol=1e-10)


@sizes
@pytest.mark.parametrize("algo", ["td3", "sac"])
def test_a_stack_learns_what_a_seed_learns_alone(algo, ofe):
    alone, _ = learner_of(algo, ofe)
    stack, seed = learner_of(algo, ofe, stacked=True)
    random = torch.Generator().manual_seed(3)
    for update in range(UPDATES):
        batch = transitions(random)
        noise = torch.randn(30, alone.noise_per_transition, generator=random, dtype=torch.float64)
        batch = Batch(batch.rows, batch.next_rows, batch.discounts, noise)
        stack.update(of_a_stack(batch), stack.is_delayed_update(update, 0))
        alone.update(batch, alone.is_delayed_update(update, 0))
    for name in ("features", "actor", "critics"):
        one, other = (getattr(learner, name) for learner in (alone, seed))
        pairs = zip(one, other, strict=True) if name == "critics" else [(one, other)]
        for mine, its in pairs:
            torch.testing.assert_close(mine.values, its.values, rtol=0, atol=1e-10)


def test_the_agent_sees_few_units_alone_and_many_behind_the_observation():
    observations = torch.randn(5, SIZE, dtype=torch.float64)
    for units, size in ((2, 2), (SIZE, SIZE), (SIZE + 1, 2 * SIZE + 1)):
        learner, _ = learner_of("ddpg", OFESettings(units=units))
        seen = learner._seen(observations)
        assert seen.shape == (5, size)
        assert torch.equal(seen[:, :SIZE], observations) == (units > SIZE)


def test_units_are_shared_out_among_layers():
    assert OFESettings(units=240).widths == [40] * 6
    assert OFESettings(units=12).widths == [2] * 6
    assert OFESettings(units=14).widths == [3, 3, 2, 2, 2, 2]
    assert OFESettings(units=3).widths == [1] * 3


def test_features_learn_to_predict_real_physics_before_the_agent_and_with_it():
    ofe = OFESettings(units=12, learning_rate=3e-3, pretraining=2.0, standardize_updates=50)
    losses = []
    # The policy stays what it is at the beginning, so that only the features change.
    changes = {"uniform_warmup": False, "noise_sigma": 1.0, "learning_rate": 1e-8}
    changes |= {"learning_starts": 100, "train_freq": 50, "gradient_steps": 25}
    for pretraining in (0.0, 2.0):
        its = ofe.model_copy(update={"pretraining": pretraining})
        with engine_of("td3", [0], changes=changes, ofe=its, episode_steps=60) as engine:
            for _ in engine.learn(400):
                losses.append(engine.losses(0).get("prediction_loss"))
    unprepared, prepared = losses[:400], losses[400:]
    # The first updates come after 150 control steps, 300 of the features alone before them.
    assert unprepared[149] is prepared[149] is None
    assert prepared[150] < 0.6 * unprepared[150]
    assert unprepared[-1] < 0.9 * unprepared[150]
