"""Columns of zeros with which seeds of different input sizes share a stack."""

from collections.abc import Sequence

import torch
from torch import Tensor


def without_padding(values: Tensor, padding: Sequence[slice]) -> Tensor:
    """Returns values (..., n) without the columns of the padding."""
    return values[..., _kept(values.shape[-1], padding)] if padding else values


def with_padding(values: Tensor, padding: Sequence[slice]) -> Tensor:
    """Returns values (..., n) with zeros in the columns of the padding."""
    if not padding:
        return values
    count = values.shape[-1] + sum(columns.stop - columns.start for columns in padding)
    padded = values.new_zeros(*values.shape[:-1], count)
    padded[..., _kept(count, padding)] = values
    return padded


def weights_of(inputs: slice, units: int, start: int = 0) -> slice:
    """Returns where the weights of inputs lie in flat (inputs, units) weights.

    Args:
        start: number at which the weights begin.
    """
    return slice(start + inputs.start * units, start + inputs.stop * units)


def _kept(count: int, padding: Sequence[slice]) -> Tensor:
    """Returns a mask (count,) of the columns that are not padding."""
    kept = torch.ones(count, dtype=torch.bool)
    for columns in padding:
        kept[columns] = False
    return kept
