"""Tests of the learned kinds against numpy or torch, and of the check of other packages' kinds."""

import numpy as np
import pytest
import torch
from torch.distributions import Independent, MultivariateNormal, Normal, kl_divergence

from jbench.encoders.kind import Learned
from jbench.encoders.kinds.autoencoders import (
    Autoencoder,
    DenoisingAutoencoder,
    DynamicDenoisingAutoencoder,
)
from jbench.encoders.kinds.variational import (
    LocalDynamics,
    LocallyLinearVariationalAutoencoder,
    VariationalAutoencoder,
    divergence,
)
from jbench.encoders.loop import check_kind
from jbench.encoders.pairs import StatePairs
from jbench.encoders.registry import find_kind
from jbench.encoders.training import train_encoder
from jbench.errors import WorkError
from jbench.representation_names import ENCODER_KINDS

SIZE, LATENTS, ROWS = 7, 3, 50
LEARNED = [
    Autoencoder(),
    DenoisingAutoencoder(),
    DynamicDenoisingAutoencoder(),
    VariationalAutoencoder(hidden=5),
    LocallyLinearVariationalAutoencoder(hidden=5),
]


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def rows_of(seed=1, rows=ROWS, size=SIZE):
    return torch.empty(rows, size).uniform_(-1, 1, generator=generator(seed))


def prepared(kind):
    later = rows_of(2) if kind.steps_ahead else rows_of(1)
    actions = rows_of(5, size=1) if kind.uses_actions else None
    return kind.prepare(StatePairs(rows_of(1), later, actions), LATENTS, generator(3))


def initial(kind):
    """Initial weights with nonzero biases."""
    weights = kind.initial(SIZE, LATENTS, generator(4))
    for value in weights.values():
        value += 0.1 * torch.randn(value.shape, generator=generator(4))
    return {name: value.requires_grad_() for name, value in weights.items()}


@pytest.mark.parametrize("kind", LEARNED, ids=lambda kind: type(kind).__name__)
def test_hand_written_gradient_equals_autograd(kind):
    weights, batch = initial(kind), prepared(kind)
    before = [None if part is None else part.clone() for part in batch]
    found, expected = ({n: torch.empty_like(v) for n, v in weights.items()} for _ in range(2))
    loss = kind.gradient(weights, found, batch)
    reference = Learned.gradient(kind, weights, expected, batch)
    assert loss.item() == pytest.approx(reference.item(), rel=1e-5)
    for name in weights:
        torch.testing.assert_close(found[name], expected[name], rtol=1e-4, atol=1e-7)
    # The batch is unchanged: a second call has the same result.
    for part, was in zip(batch, before, strict=True):
        assert part is was or torch.equal(part, was)


def test_autoencoder_is_two_tanh_layers_with_glorot_weights():
    weights = Autoencoder().initial(16, 12, generator())
    limit = np.sqrt(6 / (16 + 12))
    inner, outer = (weights[f"{name}.weight"].numpy() for name in ("encoder", "decoder"))
    for matrix in (inner, outer):
        assert 0.95 * limit < np.abs(matrix).max() <= limit
    assert not weights["encoder.bias"].any()
    assert not weights["decoder.bias"].any()
    batch = rows_of(rows=5, size=16)
    rebuilt = Autoencoder().decode(weights, Autoencoder().encode(weights, batch))
    expected = np.tanh(np.tanh(batch.numpy() @ inner.T) @ outer.T)
    np.testing.assert_allclose(rebuilt.numpy(), expected, atol=1e-6)


def test_input_noise_has_requested_standard_deviation():
    clean = rows_of(rows=20_000)
    batch = DenoisingAutoencoder(noise=0.3).prepare(StatePairs(clean, clean), LATENTS, generator())
    assert batch.later is clean
    noise = batch.now - clean
    assert noise.std().item() == pytest.approx(0.3, rel=0.02)
    assert noise.mean().item() == pytest.approx(0, abs=0.005)
    assert torch.equal(
        DenoisingAutoencoder(noise=0.0).prepare(StatePairs(clean, clean), 3, generator()).now, clean
    )


def test_variational_loss_is_negative_bound_without_constant():
    kind = VariationalAutoencoder(hidden=5, observation_sd=0.4)
    weights, batch = initial(kind), prepared(kind)
    mean, log_variance = kind.posterior(weights, batch.now)
    sd = (log_variance / 2).exp()
    latents = mean + sd * batch.noise
    likelihood = Independent(Normal(kind.decode(weights, latents), 0.4), 1).log_prob(batch.now)
    standard = Independent(Normal(torch.zeros_like(mean), torch.ones_like(mean)), 1)
    bound = likelihood - kl_divergence(Independent(Normal(mean, sd), 1), standard)
    constant = SIZE * (np.log(0.4) + np.log(2 * np.pi) / 2)
    expected = (-bound - constant).mean().item()
    assert kind.loss(weights, batch).item() == pytest.approx(expected, rel=1e-4)
    assert torch.equal(kind.encode(weights, batch.now), mean)


def test_divergence_of_predicted_latents_equals_torch():
    draw = generator(6)
    v, r, B, o, mean, later = (0.4 * torch.randn(ROWS, LATENTS, generator=draw) for _ in range(6))
    log_variance, later_log_variance = (
        torch.randn(ROWS, LATENTS, generator=draw) - 1 for _ in range(2)
    )
    actions = torch.randn(ROWS, 1, generator=draw)
    dynamics = LocalDynamics(v, r, B, o)
    matrix = torch.eye(LATENTS) + v[:, :, None] * r[:, None, :]
    predicted = (matrix @ mean[:, :, None])[:, :, 0] + B * actions + o
    torch.testing.assert_close(dynamics(mean, actions), predicted)
    covariance = matrix @ torch.diag_embed(log_variance.exp()) @ matrix.mT
    expected = kl_divergence(
        MultivariateNormal(predicted, (covariance + covariance.mT) / 2),
        MultivariateNormal(later, torch.diag_embed(later_log_variance.exp())),
    )
    found = divergence(dynamics, predicted, log_variance, later, later_log_variance)
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)


def test_dynamic_bound_has_four_terms():
    kind = LocallyLinearVariationalAutoencoder(hidden=5)
    weights, batch = initial(kind), prepared(kind)
    mean, log_variance = kind.posterior(weights, batch.now)
    latents = mean + (log_variance / 2).exp() * batch.noise
    dynamics = kind.transition(weights, latents)
    plain = VariationalAutoencoder(hidden=5).loss(weights, batch)
    predicted = kind.decode(weights, dynamics(latents, batch.actions))
    nll = ((predicted - batch.later) / 0.1).square().sum(1).mean() / 2
    later, means = kind.posterior(weights, batch.later), dynamics(mean, batch.actions)
    apart = divergence(dynamics, means, log_variance, *later).mean()
    expected = (plain + nll + 0.1 * apart).item()
    assert kind.loss(weights, batch).item() == pytest.approx(expected, rel=1e-5)


class Linear(Learned):
    """A linear autoencoder with shared weights."""

    def initial(self, size, latents, random):
        return {"matrix": torch.ones(size, latents)}

    def encode(self, weights, scaled):
        return scaled @ weights["matrix"]

    def decode(self, weights, latents):
        return latents @ weights["matrix"].T

    def loss(self, weights, batch):
        return (self.decode(weights, self.encode(weights, batch.now)) - batch.later).square().mean()


class OnlyTorch(Linear):
    def encode(self, weights, scaled):
        return torch.tanh(scaled @ weights["matrix"])


class NoReduction(Linear):
    def encode(self, weights, scaled):
        return scaled

    def loss(self, weights, batch):
        return (batch.now @ weights["matrix"]).square().mean()


class LossOfRows(Linear):
    def loss(self, weights, batch):
        return self.encode(weights, batch.now).square()


REFUSED = [
    (type("Mine", (Linear,), {"loss": Learned.loss}), "it has no method loss"),
    (type("Mine", (Linear,), {"initial": Learned.initial}), "it has no method initial or constant"),
    (
        OnlyTorch,
        r"encode or decode of numpy arrays fails \(TypeError: .*ndarray, line \d+ of ",
    ),
    (NoReduction, r".*encode returns the shape \(1, 16\), not \(1, 5\)"),
    (LossOfRows, r"loss fails \(RuntimeError: grad can be .* only for scalar"),
]


@pytest.mark.parametrize(
    "name", [name for name in ENCODER_KINDS if issubclass(find_kind(name), Learned)]
)
def test_shipped_kinds_pass_the_check(trained, name):
    check_kind(find_kind(name)(), name, trained.states, 4)


@pytest.mark.parametrize(("kind", "reason"), REFUSED)
def test_method_that_fails_is_named(trained, kind, reason):
    with pytest.raises(WorkError, match=f"encoder mine can't be used: {reason}.*describes"):
        check_kind(kind(), "mine", trained.states, 5)


def test_training_does_not_begin_if_a_method_fails(trained, results, monkeypatch):
    monkeypatch.setattr("jbench.encoders.training.make_kind", lambda name, options: OnlyTorch())
    for module in ("training", "registry"):
        monkeypatch.setattr(f"jbench.encoders.{module}.ENCODER_KINDS", {})
    with pytest.raises(WorkError, match="decode of numpy arrays fails"):
        train_encoder(trained.settings, trained.states, results)
    assert results.scan("encoder")[0] == []
