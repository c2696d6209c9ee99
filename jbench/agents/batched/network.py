"""ReLU networks with hand-written gradients, for one seed or a stack of seeds.

Autograd allocates every intermediate result and computes gradients that are not needed. Here
activations have fixed buffers, shared by networks that are not used at the same time, so the cost
is that of the matrix products. The gradients are tested against autograd.
"""

from collections.abc import Iterable
from typing import NamedTuple

import torch
from torch import Tensor

from jbench.agents.batched.tensors import SeedView, aligned, flat_parts, flat_size

Sizes = tuple[int, ...]
"""Inputs, units of each hidden layer, outputs."""


class Affine(NamedTuple):
    """One layer's parameters, as views of the flat parameters of its network.

    Attributes:
        weight: (..., inputs, units), the transpose of torch.nn.Linear's.
        bias: (..., units).
    """

    weight: Tensor
    bias: Tensor


def parameter_count(sizes: Sizes, joins: int = 0, actions: int = 0) -> int:
    """Returns the length of the flat parameters of a `Network`, padding included."""
    return affine_count(_padded(sizes, joins, actions))


def affine_count(shapes: Iterable[tuple[int, int]]) -> int:
    """Returns the length of the flat parameters of (inputs, units) layers, alignment included."""
    return flat_size(_weights_and_biases(shapes))


def affine_views(flat: Tensor, shapes: Iterable[tuple[int, int]]) -> list[Affine]:
    """Returns views of (inputs, units) layers in flat (..., affine_count(shapes)) parameters."""
    parts = flat_parts(flat, _weights_and_biases(shapes))
    return [Affine(*pair) for pair in zip(parts[::2], parts[1::2], strict=True)]


def affines(flat: Tensor, sizes: Sizes, joins: int = 0, actions: int = 0) -> list[Affine]:
    """Returns views of a `Network`'s layers, without padding, in its flat parameters."""
    return [
        Affine(weight[..., :inputs, :units], bias[..., :units])
        for (weight, bias), inputs, units in zip(
            affine_views(flat, _padded(sizes, joins, actions)),
            _inputs(sizes, joins, actions),
            sizes[1:],
            strict=True,
        )
    ]


class Network:
    """A network of one seed, or of each seed of a stack."""

    def __init__(
        self,
        view: SeedView,
        sizes: Sizes,
        values: Tensor,
        gradient: Tensor | None = None,
        *,
        workspace: str,
        joins: int = 0,
        actions: int = 0,
    ) -> None:
        """Makes the views of the parameters.

        Args:
            values: (..., parameter_count(sizes, joins, actions)) flat parameters.
            gradient: like `values`, written by `backward`; None for a network without gradient.
            workspace: name of the activation buffers. Of the networks that share them, only the
                last one that was evaluated can go backward.
            joins: index of the layer that takes the actions.
            actions: number of the last inputs that are actions.
        """
        self.sizes, self.values, self.gradient = sizes, values, gradient
        self.joins, self.actions = joins, actions
        self.view, self._workspace = view, workspace
        # Columns of the actions among the inputs of their layer.
        end = _inputs(sizes, joins, actions)[joins]
        self._columns = slice(end - actions, end)
        shapes, last = _padded(sizes, joins, actions), len(sizes) - 2
        gradients = affine_views(values if gradient is None else gradient, shapes)
        pairs = list(zip(affine_views(values, shapes), gradients, strict=True))
        self._exact = [Layer(*pair) for pair in pairs]
        self.first_units = self._exact[0].units  # of the first layer, with padding
        self._layers = [
            _LowPrecisionLayer(*pair, view, f"{workspace} {i}")
            if view.low_precision and 0 < i < last
            else layer
            for i, (pair, layer) in enumerate(zip(pairs, self._exact, strict=True))
        ]
        self._memory: dict[int, _Memory] = {}
        self._inputs, self._units = torch.empty(0), _Memory([], [], [])

    @property
    def layers(self) -> list[Affine]:
        """The layers, as views of the parameters."""
        return affines(self.values, self.sizes, self.joins, self.actions)

    def forward(self, inputs: Tensor, *, exact: bool = False) -> Tensor:
        """Returns the outputs (..., batch, sizes[-1]) for inputs (..., batch, sizes[0]).

        Args:
            exact: multiply every layer in full precision; `backward` can't follow.
        """
        layers = self._exact if exact else self._layers
        self._inputs = inputs[..., : -self.actions] if self.joins else inputs
        self._units = self._memory_of(inputs.shape[-2])
        values = self._inputs
        for i, (layer, units) in enumerate(zip(layers, self._units.units, strict=False), 1):
            values = layer.forward(values, units).clamp_min_(0)
            if i == self.joins:
                values[..., self._columns].copy_(inputs[..., -self.actions :])
        return layers[-1].forward(values)

    def backward(self, delta: Tensor) -> None:
        """Writes the gradient by the parameters, given that by the outputs (same shape)."""
        for i in range(len(self._layers) - 1, 0, -1):
            self._layers[i].differentiate(delta, self._units.transposed[i - 1])
            delta = self._propagate(i, delta)
        self._layers[0].differentiate(delta, self._inputs.mT)

    def action_gradient(self, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient (..., batch, actions) of a loss by the actions.

        Args:
            delta: gradient of the loss by the outputs, same shape.
            rows: indices of the batch that the loss depends on, as in `delta`; None for all.
                Requires a single seed.
        """
        return self._input_gradient(delta, self._columns, rows)

    def polyak_update(self, network: "Network", tau: float) -> None:
        """Updates a target network: target <- (1 - tau) target + tau network."""
        self.values.lerp_(network.values, tau)

    def _input_gradient(self, delta: Tensor, columns: slice, rows: Tensor | None) -> Tensor:
        """Returns the gradient (..., batch, columns) by some inputs of the layer `joins`."""
        for i in range(len(self._layers) - 1, self.joins, -1):
            delta = self._propagate(i, delta, rows)
        return self._layers[self.joins].propagate_to(delta, columns)

    def _propagate(self, i: int, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient by the inputs of layer i before their ReLU."""
        units, before = self._units.units[i - 1], self._units.deltas[i - 1]
        if rows is not None:
            units, before = units.index_select(0, rows), before[: len(rows)]
        self._layers[i].propagate(delta, before)
        # ReLU's derivative from its output: one pass over memory, where a mask would need two.
        torch.ops.aten.threshold_backward.grad_input(before, units, 0, grad_input=before)
        if i == self.joins:
            # These units are inputs: the layers below do not depend on them.
            before[..., self._columns].zero_()
        return before

    def _memory_of(self, batch: int) -> "_Memory":
        if batch not in self._memory:
            units, deltas = (
                [
                    self.view.scratch(f"{name} {i}", batch, width)
                    for i, width in enumerate(layer.units for layer in self._exact[:-1])
                ]
                for name in (self._workspace, "delta")
            )
            self._memory[batch] = _Memory(units, [unit.mT for unit in units], deltas)
        return self._memory[batch]


class _Memory(NamedTuple):
    """Buffers of a network for one batch size, per hidden layer.

    Attributes:
        units: (..., batch, units) activations.
        transposed: (..., units, batch) views of `units`.
        deltas: (..., batch, units) gradients by the units.
    """

    units: list[Tensor]
    transposed: list[Tensor]
    deltas: list[Tensor]


class Layer:
    """An affine layer and its gradients by parameters and inputs."""

    def __init__(self, affine: Affine, gradient: Affine) -> None:
        stacked = affine.weight.ndim == 3
        self._affine = torch.baddbmm if stacked else torch.addmm
        self._product = torch.bmm if stacked else torch.mm
        self._weight, self._bias = affine.weight, affine.bias.unsqueeze(-2)
        self._transposed = self._weight.mT
        self._gradient = gradient
        self.units = affine.weight.shape[-1]

    def forward(self, inputs: Tensor, out: Tensor | None = None) -> Tensor:
        """Returns inputs @ weight + bias."""
        return self._affine(self._bias, inputs, self._weight, out=out)

    def differentiate(self, delta: Tensor, transposed: Tensor) -> None:
        """Writes the gradient by the parameters, given the inputs (..., inputs, batch)."""
        self._product(transposed, delta, out=self._gradient.weight)
        torch.sum(delta, dim=-2, out=self._gradient.bias)

    def propagate(self, delta: Tensor, out: Tensor) -> None:
        """Writes the gradient by the inputs."""
        self._product(delta, self._transposed, out=out)

    def propagate_to(self, delta: Tensor, columns: slice) -> Tensor:
        """Returns the gradient (..., batch, columns) by some of the inputs."""
        return self._product(delta, self._transposed[..., columns])

    def add_propagated(self, delta: Tensor, columns: slice, out: Tensor) -> None:
        """Adds the gradient by some of the inputs to `out`, (..., batch, columns)."""
        self._affine(out, delta, self._transposed[..., columns], out=out)


class _LowPrecisionLayer(Layer):
    """A layer that multiplies in bfloat16; its inputs and outputs are not rounded.

    The backward pass reuses the numbers rounded in the forward pass.
    """

    def __init__(self, affine: Affine, gradient: Affine, view: SeedView, workspace: str) -> None:
        super().__init__(affine, gradient)
        self._view, self._names = view, {name: f"{workspace} {name}" for name in _ROUNDED}

    def forward(self, inputs: Tensor, out: Tensor | None = None) -> Tensor:
        """See `Layer.forward`."""
        assert out is not None
        low_inputs = self._low("inputs", inputs).copy_(inputs)
        low_weight = self._low("weight", self._weight).copy_(self._weight)
        product = self._product(low_inputs, low_weight, out=self._low("outputs", out))
        return out.copy_(product).add_(self._bias)

    def differentiate(self, delta: Tensor, transposed: Tensor) -> None:
        """See `Layer.differentiate`."""
        gradient = self._gradient.weight
        low_inputs = self._low("inputs", transposed.mT)
        low_delta = self._low("delta", delta).copy_(delta)
        product = self._product(low_inputs.mT, low_delta, out=self._low("gradient", gradient))
        gradient.copy_(product)
        torch.sum(delta, dim=-2, out=self._gradient.bias)

    def propagate(self, delta: Tensor, out: Tensor) -> None:
        """See `Layer.propagate`."""
        rows = delta.shape[-2]
        # SAC passes any number of rows; without padding each number would need its own buffers.
        padded = -(-rows // _ROWS) * _ROWS
        low_delta, by_inputs = (
            self._scratch(name, padded, like.shape[-1])
            for name, like in (("delta", delta), ("by_inputs", out))
        )
        low_delta[..., :rows, :].copy_(delta)
        low_weight = self._low("weight", self._weight)
        out.copy_(self._product(low_delta, low_weight.mT, out=by_inputs)[..., :rows, :])

    def _low(self, name: str, like: Tensor) -> Tensor:
        """Returns a bfloat16 buffer, shared by the layers of a workspace."""
        return self._scratch(name, *like.shape[-2:])

    def _scratch(self, name: str, *shape: int) -> Tensor:
        return self._view.scratch(self._names[name], *shape, dtype=torch.bfloat16)


_ROWS = 32  # bfloat16 products of variable size are padded to a multiple of this
_ROUNDED = ("inputs", "weight", "outputs", "delta", "gradient", "by_inputs")


def _weights_and_biases(shapes: Iterable[tuple[int, int]]) -> list[tuple[int, ...]]:
    """Returns the shapes of weight and bias of each of some (inputs, units) layers."""
    return [shape for inputs, units in shapes for shape in ((inputs, units), (units,))]


def _inputs(sizes: Sizes, joins: int, actions: int) -> list[int]:
    """Returns the number of inputs of each layer if the actions join layer `joins`."""
    inputs = list(sizes[:-1])
    inputs[0] -= actions
    inputs[joins] += actions
    return inputs


def _padded(sizes: Sizes, joins: int, actions: int) -> list[tuple[int, int]]:
    """Returns inputs and units of each layer as they are stored.

    Hidden units are padded to whole vectors of the processor, which makes the products a tenth
    faster. Weights and gradients of the padding are 0; actions that join take its first places.
    """
    first, *rest = _inputs(sizes, joins, actions)
    inner = [aligned(inputs) for inputs in rest]
    return list(zip((first, *inner), (*inner, sizes[-1]), strict=True))
