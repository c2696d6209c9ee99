"""Features learned with an agent by predicting the next observation (OFENet).

Source: Ota et al. (2020), "Can Increasing Input Dimensionality Improve Deep Reinforcement
Learning?", arXiv:2003.01629. `docs/features.md` lists the differences.
"""

from collections.abc import Sequence

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.layers import Affine, Layer, affine_count, affine_views
from jbench.agents.batched.learner import initialize_uniform
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.tensors import Tensors
from jbench.policies.layer_sequences import MAX_INPUT, feature_layers
from jbench.policies.layers import Divide, Linear, SavedLayer, Shift
from jbench.settings.records import OFESettings

MIN_DEVIATION = 1e-3
"""Its square is added to a variance, so that constant observations can be standardized."""


class DenseLayers:
    """Layers of SiLU units, each of which takes the inputs and all previous units.

    Inputs and units share one row of `size` numbers: every layer reads the beginning of the row and
    writes the columns that follow.
    """

    def __init__(self, view: Tensors, name: str, inputs: int, layers: Sequence[Layer]) -> None:
        self._view = view
        self._name = name
        self._layers = layers
        self._spans: list[tuple[int, int]] = []
        self.size = inputs
        for layer in layers:
            self._spans.append((self.size, self.size + layer.units))
            self.size += layer.units
        # Of the last forward pass: each layer, its buffer before the SiLU, and its columns.
        self._used: list[tuple[Layer, Tensor, tuple[int, int]]] = []
        self._rows = torch.empty(0)

    def rows(self, batch: int) -> Tensor:
        """Returns a buffer (..., batch, size), whose first columns are for the inputs."""
        return self._view.scratch(f"{self._name} rows", batch, self.size)

    def forward(self, rows: Tensor) -> None:
        """Computes the units and writes them to the columns after the inputs of `rows`."""
        self._rows = rows
        batch = rows.shape[-2]
        self._used = [
            (layer, self._view.scratch(f"{self._name} raw {i}", batch, layer.units), span)
            for i, (layer, span) in enumerate(zip(self._layers, self._spans, strict=True))
        ]
        for layer, raw, (start, end) in self._used:
            layer.forward(rows[..., :start], raw)
            torch.ops.aten.silu.out(raw, out=rows[..., start:end])

    def backward(
        self, by_rows: Tensor, first: int, *, learn: bool, selected: Tensor | None = None
    ) -> None:
        """Backpropagates through the layers; adds to `by_rows` in place.

        Args:
            by_rows: (..., batch, size - first) gradient by the columns from `first` on.
            first: at most the number of inputs.
            learn: whether to write the gradient by the layers' parameters.
            selected: indices of the batch that `by_rows` belongs to (a single seed, not `learn`).
        """
        for layer, raw, (start, end) in reversed(self._used):
            layer_raw = raw if selected is None else raw.index_select(0, selected)
            by_units = by_rows[..., start - first : end - first]
            delta = torch.ops.aten.silu_backward(by_units, layer_raw)
            if learn:
                layer.differentiate(delta, self._rows[..., :start].mT)
            if start > first:
                layer.add_propagated(delta, slice(first, start), by_rows[..., : start - first])


class Features:
    """Features z_o = phi_o(o) and z_oa = phi_oa(z_o, a), and their training.

    A linear layer predicts the next observation from z_oa. The inputs of phi_o and phi_oa are
    standardized by mean and variance over the minibatches of the first updates. Observations that
    are appended to the features for the agent are not standardized. `size` is that of z_o, and
    `layers` are those of phi_o and phi_oa and the output layer.
    """

    def __init__(
        self, settings: OFESettings, observation_size: int, action_size: int, view: Tensors
    ) -> None:
        self._settings = settings
        self._view = view
        self._observation_size = observation_size
        self._action_size = action_size
        self._appended = settings.units > observation_size
        self.size = settings.units + (observation_size if self._appended else 0)
        pair_size = self.size + action_size
        self.state_action_size = pair_size + settings.units
        shapes = _shapes(observation_size, settings.widths)
        shapes += _shapes(pair_size, settings.widths)
        shapes.append((self.state_action_size, observation_size))
        self.shapes = shapes
        count = affine_count(shapes)
        self.values = view.state("features", count)
        self.gradient = view.scratch("features.gradient", count)
        self.layers = affine_views(self.values, shapes)
        pairs = zip(self.layers, affine_views(self.gradient, shapes), strict=True)
        *layers, self._head = [Layer(*pair) for pair in pairs]
        depth = len(settings.widths)
        self._phi_o = DenseLayers(view, "phi_o", observation_size, layers[:depth])
        self._phi_oa = DenseLayers(view, "phi_oa", pair_size, layers[depth:])
        self._adam = Adam(view, "features", self.values, self.gradient, settings.learning_rate)
        self._mean = view.state("features.mean", observation_size)
        self._variance = view.state("features.variance", observation_size)

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed; mean 0 and variance 1 standardize nothing."""
        initialize_uniform(self.layers, generator, "glorot")
        self._variance.fill_(1)

    def observation_features(self, observations: Tensor, out: Tensor) -> Tensor:
        """Writes and returns z_o (..., N, size) of observations (..., N, dim(O))."""
        rows = self._forward(observations)
        if self._appended:
            out[..., : self._observation_size].copy_(observations)
        out[..., -self._settings.units :].copy_(rows[..., self._observation_size :])
        return out

    def state_action_features(self, state_actions: Tensor) -> Tensor:
        """Returns z_oa (..., N, state_action_size) for z_o and a (..., N, size + dim(A))."""
        rows = self._forward_state_actions(state_actions)
        if self._appended:
            rows[..., : self._observation_size].copy_(state_actions[..., : self._observation_size])
        return rows

    def action_gradient(self, by_features: Tensor, selected: Tensor | None) -> Tensor:
        """Returns the gradient (..., N, dim(A)) by the actions of the last `state_action_features`.

        Overwrites that by the columns of z_oa after z_o, (..., N, dim(A) + units).
        """
        self._phi_oa.backward(by_features, self.size, learn=False, selected=selected)
        return by_features[..., : self._action_size]

    def learn(self, batch: Batch) -> Tensor:
        """Makes one update; returns the squared errors (..., N, dim(O)) before it.

        With the prediction p = W z_oa + b of the standardized next observation o', d = dim(O):

            L = 1 / (N d) sum |p - o'|^2      dL / dp = 2 (p - o') / (N d)

        This gradient goes back through W and phi_oa to z_oa; its columns that hold the units of
        phi_o then go back through phi_o.
        """
        self._standardize_by(batch.observations)
        shape = batch.observations.shape[-2], self.size + self._action_size
        state_actions = self._view.scratch("features.state_actions", *shape)
        self.observation_features(batch.observations, state_actions[..., : self.size])
        state_actions[..., self.size :].copy_(batch.actions)
        features = self._forward_state_actions(state_actions)
        errors = self._head.forward(features)
        errors.sub_(self._standardized(batch.next_observations))

        delta = errors * (2 / self._observation_size * batch.mean_weight)
        self._head.differentiate(delta, features.mT)
        by_features = self._view.scratch("features.by_features", *features.shape[-2:])
        self._head.propagate(delta, by_features)
        self._phi_oa.backward(by_features, 0, learn=True)
        by_units = by_features[..., self.size - self._settings.units : self.size]
        self._phi_o.backward(by_units, self._observation_size, learn=True)
        self._adam.step()
        return errors.square_()

    @property
    def observation_layers(self) -> list[Affine]:
        """The layers of phi_o, as views of the parameters."""
        return self.layers[: len(self._settings.widths)]

    def saved_layers(self, linear: Sequence[Linear]) -> list[SavedLayer]:
        """Returns phi_o of a single seed for a saved policy, from its linear layers."""
        mean = self._mean.float().cpu().numpy().copy()
        deviation = self._deviation().float().cpu().numpy().copy()
        return feature_layers(mean, deviation, linear, self._appended)

    def load_standardization(self, layers: Sequence[SavedLayer]) -> None:
        """Sets the mean and a variance whose deviation is that of `saved_layers`, bit for bit."""
        center, scale = layers[:2]
        assert isinstance(center, Shift)
        assert isinstance(scale, Divide)
        self._mean.copy_(torch.from_numpy(-center.offset))
        deviation = torch.from_numpy(scale.divisor)
        wanted = deviation.to(self._variance)
        nearest = (deviation.double() ** 2 - MIN_DEVIATION**2).to(self._variance)
        unit = torch.finfo(nearest.dtype).eps * (nearest.abs() + MIN_DEVIATION**2)
        self._variance.copy_(nearest)
        for step in (0.5, -0.5, 1, -1, 2, -2):
            missed = self._deviation() != wanted
            self._variance.copy_(torch.where(missed, nearest + step * unit, self._variance))

    def _forward(self, observations: Tensor) -> Tensor:
        """Returns the standardized observations and the units of phi_o."""
        rows = self._phi_o.rows(observations.shape[-2])
        rows[..., : self._observation_size].copy_(self._standardized(observations))
        self._phi_o.forward(rows)
        return rows

    def _forward_state_actions(self, state_actions: Tensor) -> Tensor:
        """Returns z_oa, in which an appended observation is standardized."""
        rows = self._phi_oa.rows(state_actions.shape[-2])
        rows[..., : self.size + self._action_size].copy_(state_actions)
        if self._appended:
            observations = state_actions[..., : self._observation_size]
            rows[..., : self._observation_size].copy_(self._standardized(observations))
        self._phi_oa.forward(rows)
        return rows

    def _standardized(self, observations: Tensor) -> Tensor:
        """Returns standardized observations, clipped to [-`MAX_INPUT`, `MAX_INPUT`]."""
        centered = observations - self._mean.unsqueeze(-2)
        return centered.div_(self._deviation().unsqueeze(-2)).clamp_(-MAX_INPUT, MAX_INPUT)

    def _deviation(self) -> Tensor:
        """Returns the standard deviation of the observations, which is never 0."""
        return (self._variance + MIN_DEVIATION**2).sqrt_()

    def _standardize_by(self, observations: Tensor) -> None:
        """Merges a minibatch into mean and variance (Chan, Golub and LeVeque, 1979)."""
        before = self._adam.steps.unsqueeze(-1)
        weight = (before < self._settings.standardize_updates).to(self._mean.dtype) / (before + 1)
        variance, mean = torch.var_mean(observations, dim=-2, correction=0)
        step = (mean - self._mean) * weight
        self._variance.mul_(1 - weight).addcmul_(variance, weight)
        # weight * (1 - weight) * difference ** 2
        self._variance.addcmul_(step * (1 - weight), mean - self._mean)
        self._mean.add_(step)


def _shapes(inputs: int, widths: list[int]) -> list[tuple[int, int]]:
    """Returns inputs and units of densely connected layers with these numbers of units."""
    return [(inputs + sum(widths[:i]), width) for i, width in enumerate(widths)]
