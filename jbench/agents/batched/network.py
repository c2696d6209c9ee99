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
    actions: int = 0  # number of the last inputs that are actions
    joins: int = 0  # index of the layer that takes them

    @property
    def inputs(self) -> list[int]:
        """Number of inputs of each layer."""
        inputs = list(self.sizes[:-1])
        inputs[0] -= self.actions
        inputs[self.joins] += self.actions
        return inputs

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


class Network:
    """A network of one seed, or of each of a stack; `layers` are views without padding."""

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
        self.layout, self.values, self.gradient = layout, values, gradient
        self.view, self._workspace = view, workspace
        self.layers = layout.views(values)
        self._joins, self._actions = layout.joins, layout.actions
        # Columns of the actions among the inputs of their layer.
        end = layout.inputs[layout.joins]
        self._columns = slice(end - layout.actions, end)
        shapes, last = layout.stored, len(layout.stored) - 1
        gradients = affine_views(values if gradient is None else gradient, shapes)
        pairs = list(zip(affine_views(values, shapes), gradients, strict=True))
        self._exact = [Layer(*pair) for pair in pairs]
        self._layers = [
            BFloat16Layer(*pair, view, f"{workspace} {i}")
            if view.low_precision and 0 < i < last
            else layer
            for i, (pair, layer) in enumerate(zip(pairs, self._exact, strict=True))
        ]
        # Of each size of batch, buffers (..., batch, units) of each hidden layer, their transposes
        # and those of the gradients.
        self._memory: dict[int, list[list[Tensor]]] = {}
        self._inputs, self._used = torch.empty(0), list[list[Tensor]]()

    def forward(self, inputs: Tensor, *, exact: bool = False) -> Tensor:
        """Returns the outputs (..., batch, sizes[-1]) for inputs (..., batch, sizes[0]).

        If `exact`, every layer is multiplied in full precision, and `backward` can't follow.
        """
        layers = self._exact if exact else self._layers
        self._inputs = inputs[..., : -self._actions] if self._joins else inputs
        self._used = self._buffers(inputs.shape[-2])
        values = self._inputs
        for i, (layer, units) in enumerate(zip(layers, self._used[0], strict=False), 1):
            values = layer.forward(values, units).clamp_min_(0)
            if i == self._joins:
                values[..., self._columns].copy_(inputs[..., -self._actions :])
        return layers[-1].forward(values)

    def backward(self, delta: Tensor) -> None:
        """Writes the gradient by the parameters, given that by the outputs (same shape)."""
        for i in range(len(self._layers) - 1, 0, -1):
            self._layers[i].differentiate(delta, self._used[1][i - 1])
            delta = self._propagate(i, delta)
        self._layers[0].differentiate(delta, self._inputs.mT)

    def action_gradient(self, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient (..., batch, actions) by the actions, given that by the outputs.

        Of a single seed, it may be that of a loss of some rows of the batch, given their indices.
        """
        for i in range(len(self._layers) - 1, self._joins, -1):
            delta = self._propagate(i, delta, rows)
        return self._layers[self._joins].propagate_to(delta, self._columns)

    def _propagate(self, i: int, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        units, before = self._used[0][i - 1], self._used[2][i - 1]
        if rows is not None:
            units, before = units.index_select(0, rows), before[: len(rows)]
        self._layers[i].propagate(delta, before)
        # ReLU's derivative from its output: one pass over memory, where a mask would need two.
        torch.ops.aten.threshold_backward.grad_input(before, units, 0, grad_input=before)
        if i == self._joins:
            # These units are inputs: the layers below do not depend on them.
            before[..., self._columns].zero_()
        return before

    def _buffers(self, batch: int) -> list[list[Tensor]]:
        if batch not in self._memory:
            widths = [layer.units for layer in self._exact[:-1]]
            units, deltas = (
                [self.view.scratch(f"{name} {i}", batch, width) for i, width in enumerate(widths)]
                for name in (self._workspace, "delta")
            )
            self._memory[batch] = [units, [unit.mT for unit in units], deltas]
        return self._memory[batch]
