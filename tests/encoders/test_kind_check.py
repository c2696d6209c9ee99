"""Tests of the check of kinds of other packages before their training."""

import pytest
import torch

from jbench.encoders.kind import Learned
from jbench.encoders.loop import check_kind
from jbench.encoders.registry import find_kind
from jbench.encoders.training import train_encoder
from jbench.errors import WorkError
from jbench.names import ENCODER_KINDS


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


class WithoutLoss(Linear):
    loss = Learned.loss


class WithoutInitial(Linear):
    initial = Learned.initial


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
    (WithoutLoss, "it has no method loss"),
    (WithoutInitial, "it has no method initial or constants"),
    (OnlyTorch, r"encode or decode of numpy arrays fails \(TypeError: .*numpy.ndarray\)"),
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
    with pytest.raises(WorkError, match=f"encoder mine can't be trained: {reason}.*describes"):
        check_kind(kind(), "mine", trained.states, 5)


def test_training_does_not_begin_if_a_method_fails(trained, results, monkeypatch):
    monkeypatch.setattr("jbench.encoders.training.make_kind", lambda name, options: OnlyTorch())
    monkeypatch.setattr("jbench.encoders.training.ENCODER_KINDS", {})
    with pytest.raises(WorkError, match="decode of numpy arrays fails"):
        train_encoder(trained.settings, trained.states, results)
    assert results.scan("encoder")[0] == []
