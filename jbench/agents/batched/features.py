"""Features that are learned with an agent, by predicting the next observation.

Source: Ota et al. (2020), "Can Increasing Input Dimensionality Improve Deep Reinforcement
Learning?", arXiv:2003.01629. `docs/agents.md` says what differs from it.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.dense import DenseLayers
from jbench.agents.batched.learner import initialize_uniform
from jbench.agents.batched.network import Affine, Layer, Network, affine_count, affine_views
from jbench.agents.batched.tensors import Part
from jbench.policies.feature_map import LARGEST, SMALLEST_DEVIATION, FeatureMap
from jbench.settings.ofe import OFESettings


class Features:
    """Features z_o = phi_o(o) and z_oa = phi_oa(z_o, a), and what learns them.

    A linear layer predicts the next observation from z_oa. The networks see observations that are
    standardised by the mean and variance over the minibatches of their first updates. The agent
    sees those that are appended to the units as they are.

    Attributes:
        size: of z_o.
        pair_size: of z_oa.
        values: (...,) all parameters; `gradient` is like it.
    """

    def __init__(self, settings: OFESettings, observation_size: int, part: Part) -> None:
        """Looks at the numbers of a part.

        Args:
            settings: of the features.
            observation_size: of o.
            part: whose numbers.
        """
        self._settings, self._part, self._observed = settings, part, observation_size
        self._appended = settings.units > observation_size
        self.size = settings.units + (observation_size if self._appended else 0)
        self.pair_size = self.size + 1 + settings.units
        shapes = _shapes(observation_size, settings.widths)
        self._of_observations = len(shapes)
        shapes += _shapes(self.size + 1, settings.widths)
        shapes.append((self.pair_size, observation_size))
        self._shapes, count = shapes, affine_count(shapes)
        self.values = part.keep("features", count)
        self.gradient = part.scratch("features.gradient", count)
        self.layers = self.layers_of(self.values)
        pairs = zip(self.layers, self.layers_of(self.gradient), strict=True)
        *layers, self._head = [Layer(*pair) for pair in pairs]
        first, second = layers[: len(shapes) // 2], layers[len(shapes) // 2 :]
        self._phi_o = DenseLayers(part, "phi_o", observation_size, first)
        self._phi_oa = DenseLayers(part, "phi_oa", self.size + 1, second)
        self._adam = Adam(part, "features", self.values, self.gradient, settings.learning_rate)
        self._mean = part.keep("features.mean", observation_size)
        self._variance = part.keep("features.variance", observation_size)

    def layers_of(self, flat: Tensor) -> list[Affine]:
        """Returns the layers of phi_o, of phi_oa and the last one in parameters like `values`."""
        return affine_views(flat, self._shapes)

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed; observations are not standardised yet."""
        initialize_uniform(self.layers, generator, "glorot")
        self._variance.fill_(1)

    def of_observations(self, observations: Tensor, out: Tensor) -> Tensor:
        """Writes and returns z_o (..., N, size) of observations (..., N, dim(O))."""
        rows = self._forward(observations)
        if self._appended:
            out[..., : self._observed].copy_(observations)
        out[..., -self._settings.units :].copy_(rows[..., self._observed :])
        return out

    def of_pairs(self, pairs: Tensor) -> Tensor:
        """Returns z_oa (..., N, pair_size) of z_o and an action behind it (..., N, size + 1)."""
        rows = self._forward_pairs(pairs)
        if self._appended:
            rows[..., : self._observed].copy_(pairs[..., : self._observed])
        return rows

    def action_gradient(self, by_features: Tensor, selected: Tensor | None) -> Tensor:
        """Returns the gradient (..., N, 1) of a loss by the actions of the last `of_pairs`.

        Args:
            by_features: (..., N, 1 + units) gradient by what z_oa has behind z_o; overwritten.
            selected: the pairs that `by_features` is for; all for None. Only for one seed.
        """
        self._phi_oa.backward(by_features, self.size, learn=False, selected=selected)
        return by_features[..., :1]

    def learn(self, batch: Batch) -> Tensor:
        """Makes one update; returns the squared errors (..., N, dim(O)) before it."""
        self._standardize_by(batch.observations)
        rows = self._forward(batch.observations)
        pairs = self._part.scratch("features.state_actions", rows.shape[-2], self.size + 1)
        if self._appended:
            pairs[..., : self._observed].copy_(batch.observations)
        pairs[..., -1 - self._settings.units : -1].copy_(rows[..., self._observed :])
        pairs[..., -1:].copy_(batch.actions)
        seen = self._forward_pairs(pairs)
        errors = self._head.forward(seen)
        errors.sub_(self._standardized(batch.next_observations))

        # The loss is the mean of the squared errors over the batch and the observation.
        delta = errors * (2 / self._observed * batch.share)
        self._head.differentiate(delta, seen.mT)
        by_seen = self._part.scratch("features.by_seen", *seen.shape[-2:])
        self._head.propagate(delta, by_seen)
        self._phi_oa.backward(by_seen, 0, learn=True)
        by_units = by_seen[..., self.size - self._settings.units : self.size]
        self._phi_o.backward(by_units, self._observed, learn=True)
        self._adam.step()
        return errors.square_()

    def to_map(self) -> FeatureMap:
        """Returns a copy of what gives z_o, for a saved policy; only of one seed."""
        layers = self.layers[: self._of_observations]
        return FeatureMap(
            _array(self._mean),
            _array(self._deviation()),
            [_array(layer.weight.mT) for layer in layers],
            [_array(layer.bias) for layer in layers],
            self._appended,
        )

    def _forward(self, observations: Tensor) -> Tensor:
        """Returns standardised observations and the units of phi_o behind them."""
        rows = self._phi_o.rows(observations.shape[-2])
        rows[..., : self._observed].copy_(self._standardized(observations))
        self._phi_o.forward(rows)
        return rows

    def _forward_pairs(self, pairs: Tensor) -> Tensor:
        """Returns z_oa of z_o and actions, but that an observation within it is standardised."""
        rows = self._phi_oa.rows(pairs.shape[-2])
        rows[..., : self.size + 1].copy_(pairs)
        if self._appended:
            observations = pairs[..., : self._observed]
            rows[..., : self._observed].copy_(self._standardized(observations))
        self._phi_oa.forward(rows)
        return rows

    def _standardized(self, observations: Tensor) -> Tensor:
        centred = observations - self._mean.unsqueeze(-2)
        return centred.div_(self._deviation().unsqueeze(-2)).clamp_(-LARGEST, LARGEST)

    def _deviation(self) -> Tensor:
        return (self._variance + SMALLEST_DEVIATION**2).sqrt_()

    def _standardize_by(self, observations: Tensor) -> None:
        """Makes a minibatch a part of mean and variance, if it is one of the first ones.

        Source: Chan, Golub and LeVeque (1979), the variance of two sets together.
        """
        before = self._adam.steps.unsqueeze(-1)
        weight = (before < self._settings.standardize_updates).to(self._mean.dtype) / (before + 1)
        variance, mean = torch.var_mean(observations, dim=-2, correction=0)
        step = (mean - self._mean) * weight
        self._variance.mul_(1 - weight).addcmul_(variance, weight)
        # weight * (1 - weight) * difference ** 2
        self._variance.addcmul_(step * (1 - weight), mean - self._mean)
        self._mean.add_(step)


class FeatureCritic(Network):
    """A critic that is given z_o and an action, and sees z_oa."""

    def __init__(
        self, features: Features, twin: Network | None, *args: Any, **options: Any
    ) -> None:
        """Makes the views of its parameters.

        Args:
            features: that it sees.
            twin: a critic that has always just been asked about the same pairs, and whose inputs
                are this one's; None for one that computes its own.
            args: of a `Network`.
            options: of a `Network`.
        """
        super().__init__(*args, **options)
        self._features, self._twin = features, twin

    def forward(self, inputs: Tensor, *, exact: bool = False) -> Tensor:
        """Returns the values (..., batch, 1) of z_o and actions (..., batch, size + 1)."""
        twin = self._twin
        seen = self._features.of_pairs(inputs) if twin is None else twin._inputs
        return super().forward(seen, exact=exact)

    def action_gradient(self, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient (..., batch, 1) by the actions; see `Network`."""
        places = slice(self._features.size, self._features.pair_size)
        by_features = self._input_gradient(delta, places, rows)
        return self._features.action_gradient(by_features, rows)


def _shapes(inputs: int, widths: list[int]) -> list[tuple[int, int]]:
    """Returns inputs and units of each of densely connected layers."""
    return [(inputs + sum(widths[:i]), width) for i, width in enumerate(widths)]


def _array(tensor: Tensor) -> NDArray[np.float32]:
    found: NDArray[np.float32] = tensor.float().cpu().numpy().copy(order="C")
    return found
