"""Densely connected layers with hand-written gradients (Huang et al., 2017)."""

from collections.abc import Sequence

import torch
from torch import Tensor

from jbench.agents.batched.layers import Layer
from jbench.agents.batched.tensors import Tensors


class DenseLayers:
    """Layers of SiLU units, each of which takes the inputs and all previous units.

    Inputs and units share one row: every layer reads the beginning of the row and writes the
    columns that follow.

    Attributes:
        size: number of inputs and units together.
    """

    def __init__(self, view: Tensors, name: str, inputs: int, layers: Sequence[Layer]) -> None:
        """Connects layers.

        Args:
            name: of the scratch memory.
            layers: each takes the inputs and the units of all layers before it.
        """
        self._view, self._name, self._layers = view, name, layers
        self._spans: list[tuple[int, int]] = []
        self.size = inputs
        for layer in layers:
            self._spans.append((self.size, self.size + layer.units))
            self.size += layer.units
        self._raw: list[Tensor] = []
        self._rows = torch.empty(0)

    def rows(self, batch: int) -> Tensor:
        """Returns a buffer (..., batch, size), whose first columns are for the inputs."""
        return self._view.scratch(f"{self._name} rows", batch, self.size)

    def forward(self, rows: Tensor) -> None:
        """Computes the units and writes them to the columns after the inputs of `rows`."""
        self._rows, batch = rows, rows.shape[-2]
        self._raw = [
            self._view.scratch(f"{self._name} raw {i}", batch, layer.units)
            for i, layer in enumerate(self._layers)
        ]
        for layer, raw, (start, end) in zip(self._layers, self._raw, self._spans, strict=True):
            layer.forward(rows[..., :start], raw)
            torch.ops.aten.silu.out(raw, out=rows[..., start:end])

    def backward(
        self, by_rows: Tensor, first: int, *, learn: bool, selected: Tensor | None = None
    ) -> None:
        """Backpropagates through the layers; adds to `by_rows` in place.

        Args:
            by_rows: (..., batch, size - first) gradient of a loss by the columns of the last
                forward pass from `first` on.
            first: the first column that has a gradient, at most the number of inputs.
            learn: whether to write the gradient by the layers' parameters.
            selected: indices of the batch that `by_rows` belongs to; None for all. Requires a
                single seed and `learn=False`.
        """
        layers = list(zip(self._layers, self._raw, self._spans, strict=True))
        for layer, raw, (start, end) in reversed(layers):
            layer_raw = raw if selected is None else raw.index_select(0, selected)
            by_units = by_rows[..., start - first : end - first]
            delta = torch.ops.aten.silu_backward(by_units, layer_raw)
            if learn:
                layer.differentiate(delta, self._rows[..., :start].mT)
            if start > first:
                layer.add_propagated(delta, slice(first, start), by_rows[..., : start - first])
