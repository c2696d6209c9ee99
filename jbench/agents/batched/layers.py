"""Affine layers with hand-written gradients, for one seed or a stack of seeds."""

from collections.abc import Iterable
from typing import NamedTuple

import torch
from torch import Tensor

from jbench.agents.batched.tensors import Tensors, flat_parts, flat_size


class Affine(NamedTuple):
    """One layer's parameters, as views of the flat parameters of its network."""

    weight: Tensor  # (..., inputs, units), the transpose of torch.nn.Linear's
    bias: Tensor  # (..., units)


def affine_count(shapes: Iterable[tuple[int, int]]) -> int:
    """Returns the length of the flat parameters of (inputs, units) layers, alignment included."""
    return flat_size(_weights_and_biases(shapes))


def affine_views(flat: Tensor, shapes: Iterable[tuple[int, int]]) -> list[Affine]:
    """Returns views of (inputs, units) layers in flat (..., affine_count(shapes)) parameters."""
    parts = flat_parts(flat, _weights_and_biases(shapes))
    return [Affine(*pair) for pair in zip(parts[::2], parts[1::2], strict=True)]


class Layer:
    """An affine layer and its gradients by parameters and inputs."""

    def __init__(self, affine: Affine, gradient: Affine) -> None:
        stacked = affine.weight.ndim == 3
        self._affine = torch.baddbmm if stacked else torch.addmm
        self._product = torch.bmm if stacked else torch.mm
        self._weight = affine.weight
        self._bias = affine.bias.unsqueeze(-2)
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


class BFloat16Layer(Layer):
    """A layer that multiplies in bfloat16; its inputs and outputs are not rounded.

    The backward pass reuses the numbers rounded in the forward pass.
    """

    def __init__(self, affine: Affine, gradient: Affine, view: Tensors, workspace: str) -> None:
        super().__init__(affine, gradient)
        self._view = view
        self._workspace = workspace

    def forward(self, inputs: Tensor, out: Tensor | None = None) -> Tensor:
        """Returns inputs @ weight + bias in `out`."""
        assert out is not None
        low_inputs = self._low("inputs", *inputs.shape[-2:]).copy_(inputs)
        low_weight = self._low("weight", *self._weight.shape[-2:]).copy_(self._weight)
        product = self._low("outputs", *out.shape[-2:])
        return out.copy_(self._product(low_inputs, low_weight, out=product)).add_(self._bias)

    def differentiate(self, delta: Tensor, transposed: Tensor) -> None:
        """Writes the gradient by the parameters, given the inputs (..., inputs, batch)."""
        low_inputs = self._low("inputs", *transposed.mT.shape[-2:])
        low_delta = self._low("delta", *delta.shape[-2:]).copy_(delta)
        product = self._low("gradient", *self._gradient.weight.shape[-2:])
        self._gradient.weight.copy_(self._product(low_inputs.mT, low_delta, out=product))
        torch.sum(delta, dim=-2, out=self._gradient.bias)

    def propagate(self, delta: Tensor, out: Tensor) -> None:
        """Writes the gradient by the inputs."""
        rows = delta.shape[-2]
        # SAC passes any number of rows; without padding each number would need its own buffers.
        padded = -(-rows // _ROWS) * _ROWS
        low_delta = self._low("delta", padded, delta.shape[-1])
        by_inputs = self._low("by_inputs", padded, out.shape[-1])
        low_delta[..., :rows, :].copy_(delta)
        low_weight = self._low("weight", *self._weight.shape[-2:])
        out.copy_(self._product(low_delta, low_weight.mT, out=by_inputs)[..., :rows, :])

    def _low(self, name: str, *shape: int) -> Tensor:
        """Returns a buffer (..., *shape) in bfloat16."""
        return self._view.scratch(f"{self._workspace} {name}", *shape, dtype=torch.bfloat16)


_ROWS = 32  # bfloat16 products of variable size are padded to a multiple of this


def _weights_and_biases(shapes: Iterable[tuple[int, int]]) -> list[tuple[int, ...]]:
    """Returns the shapes of weight and bias of each layer, given its inputs and units."""
    parts: list[tuple[int, ...]] = []
    for inputs, units in shapes:
        parts += [(inputs, units), (units,)]
    return parts
