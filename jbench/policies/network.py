"""Policies that are a sequence of layers, evaluated with numpy only."""

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import NDArray

Float = NDArray[np.float32]


@dataclass(frozen=True)
class Layer:
    """A layer: its kind, one of `LAYERS`, with its arrays and numbers by name."""

    kind: str
    arrays: Mapping[str, Float] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)


def _layer_norm(x: Float, weight: Float, bias: Float, epsilon: float) -> Float:
    centered = x - x.mean(axis=-1, keepdims=True)
    variance = np.square(centered).mean(axis=-1, keepdims=True)
    normalized: Float = centered / np.sqrt(variance + epsilon) * weight + bias
    return normalized


def _sigmoid(x: Float) -> Float:
    halved: Float = np.tanh(0.5 * x)  # does not overflow
    return 0.5 + 0.5 * halved


LAYERS: dict[str, tuple[tuple[str, ...], tuple[str, ...], Callable[..., Float]]] = {
    "linear": (("weight", "bias"), (), lambda x, weight, bias: x @ weight.T + bias),
    "layer_norm": (("weight", "bias"), ("epsilon",), _layer_norm),
    "scale": (("factor",), (), lambda x, factor: x * factor),
    "shift": (("offset",), (), lambda x, offset: x + offset),
    "clip": ((), ("low", "high"), lambda x, low, high: np.clip(x, low, high)),
    "relu": ((), (), lambda x: np.maximum(x, 0)),
    "tanh": ((), (), np.tanh),
    "sigmoid": ((), (), _sigmoid),
    "silu": ((), (), lambda x: x * _sigmoid(x)),
    "elu": (
        (),
        ("alpha",),
        lambda x, alpha: np.where(x > 0, x, alpha * np.expm1(np.minimum(x, 0))),
    ),
    "leaky_relu": ((), ("slope",), lambda x, slope: np.where(x > 0, x, slope * x)),
}
"""Names of the arrays and numbers of each kind of layer, and its function."""


@dataclass(frozen=True)
class Network:
    """A deterministic policy: layers applied one after another, then clipped to [-1, 1]."""

    layers: Sequence[Layer]

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self._linear()[0].shape[1])

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return int(self._linear()[-1].shape[0])

    def act(self, observations: Float) -> Float:
        """Returns actions (..., action_size) for (encoded) observations (..., size)."""
        values = observations.astype(np.float32, copy=False)
        for layer in self.layers:
            function = LAYERS[layer.kind][2]
            values = function(values, **layer.arrays, **layer.numbers)
            values = values.astype(np.float32, copy=False)
        return np.clip(values, -1, 1)

    def description(self) -> dict[str, Any]:
        """Returns kinds and numbers of the layers, for JSON."""
        return {"network": [{"layer": layer.kind, **layer.numbers} for layer in self.layers]}

    def tensors(self) -> dict[str, Float]:
        """Returns the arrays by name, such as 0.weight, for safetensors."""
        return {
            f"{i}.{name}": np.ascontiguousarray(array)
            for i, layer in enumerate(self.layers)
            for name, array in layer.arrays.items()
        }

    @classmethod
    def from_files(cls, weights: bytes, description: bytes) -> "Network":
        """Inverts `tensors` (as safetensors) and `description` (as JSON).

        Raises:
            ValueError: if the files are invalid, or the sizes of the layers do not match.
        """
        try:
            tensors = safetensors.numpy.load(weights)
            layers = [
                _layer(dict(described), i, tensors)
                for i, described in enumerate(json.loads(description)["network"])
            ]
        except (safetensors.SafetensorError, KeyError, TypeError) as error:
            raise ValueError(f"no policy: {error}") from None
        network = cls(layers)
        network._check_sizes()
        return network

    def _linear(self) -> list[Float]:
        return [layer.arrays["weight"] for layer in self.layers if layer.kind == "linear"]

    def _check_sizes(self) -> None:
        weights = self._linear()
        if not weights or any(weight.ndim != 2 for weight in weights):
            raise ValueError("no policy: no linear layer, or one whose weight is no matrix")
        for first, second in itertools.pairwise(weights):
            if first.shape[0] != second.shape[1]:
                raise ValueError("no policy: a layer does not fit the layer before it")
        size = self.inputs
        for layer in self.layers:
            if layer.kind == "linear":
                size = layer.arrays["weight"].shape[0]
            for name, array in layer.arrays.items():
                if name != "weight" or layer.kind != "linear":
                    allowed = {(size,)} if layer.kind == "linear" else {(size,), (1,)}
                    if array.shape not in allowed:
                        raise ValueError(f"no policy: {name} of a {layer.kind} has another size")


def _layer(described: dict[str, Any], i: int, tensors: Mapping[str, Float]) -> Layer:
    """Returns layer number i from its description and its tensors."""
    kind = described["layer"]
    arrays, numbers, _ = LAYERS[kind]
    return Layer(
        kind,
        {name: np.asarray(tensors[f"{i}.{name}"], np.float32) for name in arrays},
        {name: float(described[name]) for name in numbers},
    )
