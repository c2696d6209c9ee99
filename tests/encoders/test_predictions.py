"""Tests of the probe, which predicts the next control step, and of the predictive kinds."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from jbench.commands.encoder_tables import show_explained
from jbench.datasets import Dataset, collect, find_dataset
from jbench.encoders import load_encoder
from jbench.encoders.kinds import linear
from jbench.encoders.kinds.linear import DynamicModes, RandomFeatures, Scaled
from jbench.encoders.kinds.predictive import Contrastive, ForwardModel, angle_periods, state_changes
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.pairs import Shard, StatePairs
from jbench.encoders.predictions import TARGETS, effective_rank, predictions
from jbench.encoders.registry import make_kind
from jbench.settings.records import DatasetSettings, dataset_robot
from jbench.store import Results
from jbench.store.tables import read_tables
from jbench.tasks.find import find_task
from tests.encoders.encoder_data import observations_of, read_states, rows, train

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """The states of eight simulated episodes."""
    results = Results(tmp_path_factory.mktemp("simulated") / "results")
    collect(DatasetSettings(seed=1, steps=8000), results, threads=2)
    return read_states(find_dataset(results), seed=0)


def learned(kind, states, latents=12):
    learner = EncoderLearner(kind, states, latents)
    for _ in range(kind.epochs):
        learner.epoch()
    return {name: value.detach().numpy() for name, value in learner.weights.items()}


def probe(kind, weights, states):
    """The R² of each target, and what is the same for all of them."""
    found = predictions(kind, weights, states)
    return {row["target"]: row["r2"] for row in found}, found[0]


@pytest.mark.slow
def test_forward_predicts_yaw_rate_better_than_autoencoder(simulated):
    cheap = {"epochs": 12, "batch": 256}
    found = []
    for kind in (make_kind("forward", cheap), make_kind("dae", cheap)):
        found.append(probe(kind, learned(kind, simulated), simulated)[0]["yaw_rate"])
    assert found[0] > found[1] + 0.1


@pytest.mark.slow
def test_probe_uses_only_information_in_latents(simulated):
    class MotorSpeed(Scaled):
        """Encodes only the motor's speed, or a constant."""

        seen: bool = True

        def encode(self, weights, scaled):
            return scaled[..., 14:15] * self.seen

    (whole, of_whole), (one, of_one) = (
        probe(kind, {}, simulated) for kind in (Scaled(), MotorSpeed())
    )
    assert list(whole) == list(TARGETS)
    assert whole["yaw_rate"] > max(0.5, one["yaw_rate"] + 0.1)
    nothing, of_nothing = probe(MotorSpeed(seen=False), {}, simulated)
    # The action alone predicts part of the yaw rate, but not the reward.
    assert nothing["yaw_rate"] < whole["yaw_rate"] - 0.1
    assert nothing["reward"] < 0.1
    assert (of_one["effective_rank"], of_nothing["effective_rank"]) == (pytest.approx(1), 0)
    assert (of_whole["learned_rows"], of_whole["test_rows"]) == (6000, 2000)
    # The result does not depend on the global random state.
    torch.manual_seed(3)
    assert probe(Scaled(), {}, simulated) == (whole, of_whole)


def test_part_whose_change_is_constant_up_to_rounding_has_no_r2(tmp_path):
    task = find_task("tests.gym_tasks:clocked")
    settings = DatasetSettings(**dataset_robot(task.name, task.specs), steps=400)
    record = collect(settings, Results(tmp_path), threads=1)
    states = read_states(Dataset(record), task=task.name)
    clock = next(iter(states.learn())).states[..., 2]
    assert 0 < clock.diff(dim=1).std() < 1e-6  # it ticks by one, in float32
    found = {row["target"]: row for row in predictions(Scaled(), {}, states)}
    assert (found["clock"]["r2"], found["clock"]["linear_r2"]) == (None, None)
    # A step of semi-implicit Euler is linear in state and action.
    assert found["cart"]["linear_r2"] == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(
    ("spread", "expected"),
    [
        ((1, 1, 1), 3),
        ((5, 0, 0), 1),
        ((3, 1, 0), math.exp(-0.75 * math.log(0.75) - 0.25 * math.log(0.25))),
        ((0, 0, 0), 0),
    ],
)
def test_effective_rank_equals_value_computed_by_hand(spread, expected):
    # Orthogonal columns of mean 0, so that their lengths are the singular values.
    signs = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    assert effective_rank(signs * spread + 7) == pytest.approx(expected)


def test_encoder_without_predictions_is_read_and_shown(trained, results, capsys):
    old = results.create("encoder", trained.record.id, trained.record.settings)
    for name in ("encoder_features", "encoder_errors"):
        old.append({name: trained.record.read(name)})
    old.finish({"test_mse": 0.1})
    tables, problems = read_tables(results)
    assert problems == []
    assert tables["encoder_predictions"].num_rows == 0
    assert tables["encoders"].to_pylist()[0]["effective_rank"] is None
    show_explained([old])
    printed = capsys.readouterr().out
    assert "of the variance" in printed
    assert "R²" not in printed
    show_explained([old, trained.record])  # beside one that has them
    assert "yaw rate" in capsys.readouterr().out


def test_angle_changes_are_wrapped_and_have_unit_variance(trained):
    states = trained.states
    turns = angle_periods(states)
    gain, _ = states.scaling.gain_and_offset()
    # The motor's angle and the angle to the target are observed in units of pi.
    np.testing.assert_allclose(turns, [0] * 13 + [2 * gain[13], 0, 2 * gain[15]], rtol=1e-6)
    now, later = torch.zeros(1, 16), torch.zeros(1, 16)
    now[0, 13], later[0, 13] = float(0.99 * gain[13]), float(-0.98 * gain[13])
    now[0, 14], later[0, 14] = 0.99, -0.98
    changes = state_changes(StatePairs(now, later), turns)
    assert changes[0, 13].item() == pytest.approx(0.03 * gain[13], rel=1e-4)
    assert changes[0, 14].item() == pytest.approx(-1.97, rel=1e-4)
    kind = ForwardModel(horizon=3)
    constants = kind.constants(states)
    (shard,) = states.learn()
    batch = shard.take(torch.arange(shard.pairs(3)), 3, with_actions=True)
    scaled = state_changes(batch, turns) * constants["change.scale"]
    np.testing.assert_allclose(scaled.std(0), 1, rtol=1e-3)
    rewards = batch.rewards.mean(1) * constants["reward.scale"]
    assert rewards.std().item() == pytest.approx(1, rel=1e-3)


def test_forward_loss_is_sum_of_three_errors(simulated):
    kind = ForwardModel(hidden=5, horizon=2)
    weights = kind.initial(16, 3, torch.Generator().manual_seed(0)) | kind.constants(simulated)
    (shard,) = simulated.learn()
    batch = shard.take(torch.arange(50), 2, with_actions=True)
    w = {name: value.double().numpy() for name, value in weights.items()}

    def layer(name, values):
        return values @ w[f"{name}.weight"].T + w[f"{name}.bias"]

    now, actions = batch.now.double().numpy(), batch.actions.double().numpy()
    latents = np.tanh(layer("encoder", now))
    hidden = np.tanh(layer("hidden", np.hstack([latents, actions])))
    change = state_changes(batch, weights["change.turn"]).double().numpy()
    reward = batch.rewards.double().numpy().mean(1)[:, None] * w["reward.scale"]
    expected = (
        np.mean((layer("change", hidden) - change * w["change.scale"]) ** 2)
        + np.mean((layer("reward", hidden) - reward) ** 2)
        + np.mean((layer("decoder", latents) - now) ** 2)
    )
    assert kind.loss(weights, batch).item() == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("kind", [ForwardModel(hidden=5), Contrastive(hidden=5)])
def test_decoder_has_no_gradient_on_encoder(simulated, kind):
    weights = kind.initial(16, 3, torch.Generator().manual_seed(0))
    weights = {name: value.requires_grad_() for name, value in weights.items()}
    (shard,) = simulated.learn()
    batch = shard.take(torch.arange(50), kind.steps_ahead, with_actions=True)
    found = []
    for factor in (1, 100):
        scaled = weights | {"decoder.weight": weights["decoder.weight"] * factor}
        loss = kind.loss(scaled | kind.constants(simulated), batch)
        found.append(torch.autograd.grad(loss, weights["encoder.weight"])[0])
    assert torch.equal(*found)


def test_contrastive_loss_is_nll_of_correct_pairs(simulated):
    kind = Contrastive(hidden=5, horizon=1)
    weights = kind.initial(16, 3, torch.Generator().manual_seed(0))
    # The query is 0 for every row: all later states are equally likely.
    weights["query.weight"].zero_()
    (shard,) = simulated.learn()
    batch = shard.take(torch.arange(0, 5000, 100), 1, with_actions=True)
    readout = (kind.decode(weights, kind.encode(weights, batch.now)) - batch.now).square().mean()
    loss = kind.loss(weights, batch) - readout
    assert loss.item() == pytest.approx(math.log(50), rel=1e-5)
    cheap = Contrastive(epochs=2, batch=128)
    better = learned(cheap, simulated)
    in_torch = {name: torch.from_numpy(value) for name, value in better.items()}
    assert cheap.loss(in_torch, shard.take(torch.arange(0, 5000, 100), 5, True)) < math.log(50)


def linear_system(order, size=10, episodes=3):
    """A shard of a random linear system, observed in more features with little noise."""
    random = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(random.normal(size=(order, order)))
    seen, effect = random.normal(size=(size, order)), random.normal(size=order)
    actions = random.uniform(-1, 1, (episodes, 1000))
    hidden = np.zeros((episodes, 1001, order))
    for step in range(1000):
        hidden[:, step + 1] = 0.95 * hidden[:, step] @ rotation.T
        hidden[:, step + 1] += actions[:, step, None] * effect
    states = hidden @ seen.T + random.normal(0, 0.01, (episodes, 1001, size))
    return Shard(*(torch.from_numpy(v.astype(np.float32)) for v in (states, actions, actions)))


def states_of(shard):
    """The attributes of `States` that a kind needs."""
    return SimpleNamespace(
        learn=lambda: iter([shard]), action_size=1, size=shard.states.shape[-1], device=CPU, seed=0
    )


@pytest.mark.parametrize("order", [2, 5])
def test_dmd_recovers_order_of_linear_system_in_any_units(order):
    shard = linear_system(order)
    weights = DynamicModes().fit(states_of(shard), order)
    values = weights["singular_values"]
    assert ((values > 0.9).sum(), (values > 0.2).sum()) == (order, order)
    assert DynamicModes().summary(weights)["singular_values"] == np.round(values, 4).tolist()
    # The latents reconstruct all features except the noise.
    rebuilt = DynamicModes().decode(weights, DynamicModes().encode(weights, shard.states.numpy()))
    assert np.abs(rebuilt - shard.states.numpy()).std() < 0.02
    latents = DynamicModes().encode(weights, shard.states.numpy()).reshape(-1, order)
    # Other units of the features change neither singular values nor, except for signs, latents.
    units = np.geomspace(0.01, 100, 10).astype(np.float32)
    other = DynamicModes().fit(
        states_of(shard._replace(states=shard.states * torch.from_numpy(units))), order
    )
    np.testing.assert_allclose(other["singular_values"], values, atol=1e-4)
    again = DynamicModes().encode(other, (shard.states.numpy() * units)).reshape(-1, order)
    along = np.abs(np.corrcoef(latents.T, again.T)[:order, order:]).max(1)
    np.testing.assert_allclose(along, 1, atol=0.01)


def test_encoder_with_more_latents_than_features_is_evaluated(trained, results):
    record = train(trained.states, results, "random-features", 64)
    assert load_encoder(results, record.id).encoder.latent_size == 64
    (errors,) = record.read("encoder_errors").to_pylist()
    assert errors["pca_explained"] == pytest.approx(1, abs=1e-5)
    assert len(rows(record, "encoder_predictions")) == len(TARGETS)


def test_random_features_of_a_long_row_of_episodes_are_made_in_blocks(monkeypatch, trained):
    """Episodes that end early are one row: its latents, all at once, may not fit in memory."""
    made = []

    class Counted(RandomFeatures):
        def encode(self, weights, scaled):
            made.append(len(scaled))
            return super().encode(weights, scaled)

    shard = next(trained.states.learn())
    row = shard._replace(states=shard.states.flatten(0, 1)[None])
    states = states_of(row)
    states.learned = trained.states.learned
    whole = Counted().fit(states, 8)
    monkeypatch.setattr(linear, "MAX_PAIRS", 1000)
    in_blocks = Counted().fit(states, 8)
    assert made == [4004, *[1000] * 4, 4]
    np.testing.assert_allclose(in_blocks["back"], whole["back"], rtol=1e-6)


def test_many_random_features_reconstruct_almost_all(trained):
    kind = RandomFeatures()
    weights = kind.fit(trained.states, 64)
    seen = trained.states.scaled(observations_of(trained.dataset)).reshape(-1, 16)
    latents = kind.encode(weights, seen)
    assert latents.shape == (5005, 64)
    inputs = np.arctanh(latents)
    assert inputs.var(0).mean() == pytest.approx(1, rel=0.3)
    rebuilt = kind.decode(weights, latents)
    assert ((rebuilt - seen) ** 2).mean() < 0.05 * seen.var(0).mean()
    assert effective_rank(latents) > 16
