"""ReLU networks with hand-written gradients, for one seed or a stack of seeds.

Autograd allocates every intermediate result and computes gradients that are not needed. Here
activations have fixed buffers, shared by networks that are not used at the same time, so the cost
is that of the matrix products. The gradients are tested against autograd.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from jbench.agents.batched.layers import Affine, BFloat16Layer, Layer, affine_count, affine_views
from jbench.agents.batched.tensors import Tensors, aligned


class Layout(NamedTuple):
    """Sizes of a network's layers, and where a critic takes the actions.

    Hidden units are padded to whole vectors of the processor, which makes the products a tenth
    faster. Weights and gradients of the padding are 0; actions that join take its first places.
    """

    sizes: tuple[int, ...]  # inputs, units of each hidden layer, outputs
    actions: int = 0  # number of the last inputs that are actions, or features of them
    joins: int = 0  # index of the layer that takes them

    @property
    def inputs(self) -> list[int]:
        """Number of inputs of each layer."""
        inputs = list(self.sizes[:-1])
        inputs[0] -= self.actions
        inputs[self.joins] += self.actions
        return inputs

    @property
    def action_columns(self) -> slice:
        """Columns of the actions among the inputs of the layer that takes them."""
        end = self.inputs[self.joins]
        return slice(end - self.actions, end)

    @property
    def stored(self) -> list[tuple[int, int]]:
        """Inputs and units of each layer, padding included."""
        first, *rest = self.inputs
        inner = [aligned(inputs) for inputs in rest]
        return list(zip((first, *inner), (*inner, self.sizes[-1]), strict=True))

    @property
    def length(self) -> int:
        """Length of the flat parameters, padding included."""
        return affine_count(self.stored)

    def views(self, flat: Tensor) -> list[Affine]:
        """Returns views of the layers, without padding, in flat (..., length) parameters."""
        layers = zip(affine_views(flat, self.stored), self.inputs, self.sizes[1:], strict=True)
        return [
            Affine(weight[..., :inputs, :units], bias[..., :units])
            for (weight, bias), inputs, units in layers
        ]


class Buffers(NamedTuple):
    """Memory of the hidden layers for one size of batch; each list has a tensor per layer."""

    units: list[Tensor]  # (..., batch, units)
    transposed: list[Tensor]  # (..., units, batch), views of the units
    gradients: list[Tensor]  # (..., batch, units) by the units


class Network:
    """A network of one seed, or of each of a stack.

    Attributes:
        layers: views of the parameters, without padding.
        inputs: those of the first layer in the last forward pass.
    """

    step: Callable[[], None]

    def __init__(
        self,
        view: Tensors,
        layout: Layout,
        values: Tensor,
        gradient: Tensor | None = None,
        *,
        workspace: str,
    ) -> None:
        """Makes the views of the parameters.

        Of the networks that share the activation buffers of a workspace, only the last one that was
        evaluated can go backward.
        """
        self.layout = layout
        self.values = values
        self.gradient = gradient
        self.view = view
        self.layers = layout.views(values)
        self.inputs = torch.empty(0)

        self._workspace = workspace
        self._joins = layout.joins
        self._actions = layout.actions
        self._columns = layout.action_columns

        shapes = layout.stored
        last = len(shapes) - 1
        gradients = affine_views(values if gradient is None else gradient, shapes)
        pairs = list(zip(affine_views(values, shapes), gradients, strict=True))
        self._exact = [Layer(*pair) for pair in pairs]
        self._layers = [
            BFloat16Layer(*pair, view, f"{workspace} {i}")
            if view.low_precision and 0 < i < last
            else layer
            for i, (pair, layer) in enumerate(zip(pairs, self._exact, strict=True))
        ]
        self._buffers: dict[int, Buffers] = {}  # by the size of the batch
        self._used = Buffers([], [], [])  # in the last forward pass

    def forward(self, inputs: Tensor, *, exact: bool = False) -> Tensor:
        """Returns the outputs (..., batch, sizes[-1]) for inputs (..., batch, sizes[0]).

        If `exact`, every layer is multiplied in full precision, and `backward` can't follow.
        """
        layers = self._exact if exact else self._layers
        self.inputs = inputs[..., : -self._actions] if self._joins else inputs
        self._used = self._buffers_for(inputs.shape[-2])
        values = self.inputs
        for i, (layer, units) in enumerate(zip(layers, self._used.units, strict=False), 1):
            values = layer.forward(values, units).clamp_min_(0)
            if i == self._joins:
                values[..., self._columns].copy_(inputs[..., -self._actions :])
        return layers[-1].forward(values)

    def backward(self, delta: Tensor) -> None:
        """Writes the gradient by the parameters, given that by the outputs (same shape)."""
        for i in range(len(self._layers) - 1, 0, -1):
            self._layers[i].differentiate(delta, self._used.transposed[i - 1])
            delta = self._propagate(i, delta)
        self._layers[0].differentiate(delta, self.inputs.mT)

    def action_gradient(self, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient (..., batch, actions) by the actions, given that by the outputs.

        Of a single seed, it may be that of a loss of some rows of the batch, given their indices.
        """
        for i in range(len(self._layers) - 1, self._joins, -1):
            delta = self._propagate(i, delta, rows)
        return self._layers[self._joins].propagate_to(delta, self._columns)

    def _propagate(self, i: int, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient by the inputs of layer i, given that by its outputs."""
        units = self._used.units[i - 1]
        before = self._used.gradients[i - 1]
        if rows is not None:
            units = units.index_select(0, rows)
            before = before[: len(rows)]
        self._layers[i].propagate(delta, before)
        # ReLU's derivative from its output: one pass over memory, where a mask would need two.
        torch.ops.aten.threshold_backward.grad_input(before, units, 0, grad_input=before)
        if i == self._joins:
            # These units are inputs: the layers below do not depend on them.
            before[..., self._columns].zero_()
        return before

    def _buffers_for(self, batch: int) -> Buffers:
        """Returns the buffers of a batch of this size, which are made once."""
        if batch not in self._buffers:
            units = self._scratch(self._workspace, batch)
            transposed = [unit.mT for unit in units]
            self._buffers[batch] = Buffers(units, transposed, self._scratch("delta", batch))
        return self._buffers[batch]

    def _scratch(self, name: str, batch: int) -> list[Tensor]:
        """Returns a buffer (..., batch, units) for each hidden layer."""
        hidden = self._exact[:-1]
        return [
            self.view.scratch(f"{name} {i}", batch, layer.units) for i, layer in enumerate(hidden)
        ]
