"""Sequences of layers that several policies have, such as those that standardize observations."""

from collections.abc import Sequence

from jbench.array_types import Float32Array
from jbench.policies.layers import (
    Clip,
    Columns,
    Concat,
    Divide,
    Linear,
    Relu,
    SavedLayer,
    Shift,
    Silu,
    Tanh,
)

MAX_INPUT = 10.0
"""Bound of the absolute value of an observation that learned features standardize."""


def relu_layers(linear: Sequence[SavedLayer], squash: str) -> list[SavedLayer]:
    """Returns layers with ReLU between them and "tanh" or "clip" (to [-1, 1]) after the last."""
    last: dict[str, SavedLayer] = {"tanh": Tanh(), "clip": Clip(low=-1, high=1)}
    layers: list[SavedLayer] = []
    for layer in linear:
        layers += [layer, Relu()]

    return [*layers[:-1], last[squash]]


def standardizing_layers(
    mean: Float32Array, deviation: Float32Array, bound: float
) -> list[SavedLayer]:
    """Returns layers that standardize observations (size,) and clip them to [-bound, bound]."""
    return [
        Shift(offset=-mean),
        Divide(divisor=deviation),
        Clip(low=-bound, high=bound),
    ]


def feature_layers(
    mean: Float32Array, deviation: Float32Array, linear: Sequence[Linear], appended: bool
) -> list[SavedLayer]:
    """Returns densely connected layers of SiLU units on observations (size,) that are standardized.

    Args:
        mean: of the observations, (size,).
        deviation: standard deviation of the observations, (size,).
        linear: each takes the standardized observation and the units of the layers before it.
        appended: whether the features are the observation followed by the units, or the units.
    """
    layers = standardizing_layers(mean, deviation, MAX_INPUT)
    for layer in linear:
        layers += [layer, Silu(), Concat(earlier=len(layers))]

    layers.append(Columns(first=len(mean)))
    if appended:
        layers.append(Concat(earlier=0))

    return layers
