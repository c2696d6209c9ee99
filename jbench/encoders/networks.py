"""Layers, tanh and noise, of which the kinds of encoders are made: functions of named weights."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from jbench.arrays import Array

Weights = Mapping[str, Any]
"""Named float32 arrays, either all numpy or all torch."""


def layers(shapes: Mapping[str, tuple[int, int]], random: torch.Generator) -> dict[str, Tensor]:
    """Returns layers by name for given (outputs, inputs), with biases of 0.

    Their weights have Glorot's initialization (Glorot and Bengio, 2010).
    """
    weights: dict[str, Tensor] = {}
    for name, (outputs, inputs) in shapes.items():
        limit = (6 / (outputs + inputs)) ** 0.5
        weight = torch.empty(outputs, inputs).uniform_(-limit, limit, generator=random)
        weights[f"{name}.weight"] = weight
        weights[f"{name}.bias"] = torch.zeros(outputs)
    return weights


def affine(weights: Weights, name: str, values: Any) -> Any:
    """Applies the affine part of a named layer to (..., inputs)."""
    return values @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]


def standard_normal(shape: Sequence[int], random: torch.Generator, like: Tensor) -> Tensor:
    """Returns standard normal numbers drawn on the CPU, on the device of `like`."""
    return torch.empty(shape, dtype=like.dtype).normal_(generator=random).to(like.device)


def tanh(values: Array) -> Array:
    """Returns the hyperbolic tangent of a numpy or torch array."""
    if not isinstance(values, Tensor):
        return np.tanh(values)
    if values.requires_grad and values.device.type == "cpu":
        return _Tanh.apply(values)  # type: ignore[no-untyped-call]
    return values.tanh()


def tanh_(values: Tensor) -> Tensor:
    """Applies tanh in place, without autograd."""
    if values.device.type == "cpu":
        np.tanh(values.numpy(), out=values.numpy())
        return values
    return values.tanh_()


class _Tanh(torch.autograd.Function):
    """Numpy's tanh with its derivative; on one core about ten times as fast as torch's."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        """Computes tanh by NumPy, so that it has the bits of an encoder that acts."""
        tangents = torch.from_numpy(np.tanh(values.detach().numpy()))
        ctx.save_for_backward(tangents)
        return tangents

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        """Returns the gradient from the values of the forward pass."""
        tangents: Tensor = ctx.saved_tensors[0]
        return gradient * (1 - tangents.square())
