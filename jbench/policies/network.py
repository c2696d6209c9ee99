"""Saved policies: layers applied one after another, with numpy, or with torch to export them."""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
from array_api_compat import array_namespace
from numpy.typing import NDArray

from jbench.tasks.geometry import Array

Float = NDArray[np.float32]

MAX_INPUT = 10.0
"""Bound of the absolute value of an observation that learned features standardize."""

_DAMAGE = safetensors.SafetensorError, LookupError, TypeError, AttributeError, OverflowError
"""What reading a damaged file raises."""

_CONCAT = "concat"
"""The kind of a layer that puts an earlier result before the last one. Its number `earlier` counts
the layers before that result: 0 for the observation."""


@dataclass(frozen=True)
class SavedLayer:
    """A layer: its kind, one of `LAYERS` or "concat", with its arrays and numbers by name."""

    kind: str
    arrays: Mapping[str, Float] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)


def _layer_norm(x: Array, weight: Array, bias: Array, epsilon: float) -> Array:
    centered = x - x.mean(axis=-1, keepdims=True)
    variance = (centered * centered).mean(axis=-1, keepdims=True)
    return centered / array_namespace(x).sqrt(variance + epsilon) * weight + bias


def _tanh(x: Array) -> Array:
    return array_namespace(x).tanh(x)


def _sigmoid(x: Array) -> Array:
    return 0.5 + 0.5 * _tanh(0.5 * x)  # does not overflow


def _elu(x: Array, alpha: float) -> Array:
    xp = array_namespace(x)
    return xp.where(x > 0, x, alpha * xp.expm1(x.clip(max=0)))


LAYERS: dict[str, Callable[..., Array]] = {
    "linear": lambda x, weight, bias: x @ weight.T + bias,
    "layer_norm": _layer_norm,
    "scale": lambda x, factor: x * factor,
    "shift": lambda x, offset: x + offset,
    "divide": lambda x, divisor: x / divisor,
    "columns": lambda x, first: x[..., int(first) :],
    "clip": lambda x, low, high: x.clip(low, high),
    "relu": lambda x: x.clip(0),
    "tanh": _tanh,
    "sigmoid": _sigmoid,
    "silu": lambda x: x * _sigmoid(x),
    "elu": _elu,
    "leaky_relu": lambda x, slope: array_namespace(x).where(x > 0, x, slope * x),
}
"""The function of each kind of layer; its arguments are the layer's arrays and numbers."""


@dataclass(frozen=True)
class SavedNetwork:
    """A deterministic policy: layers applied one after another, then clipped to [-1, 1]."""

    layers: Sequence[SavedLayer]

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.linear_layers()[0].arrays["weight"].shape[1])

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return int(self.linear_layers()[-1].arrays["weight"].shape[0])

    def linear_layers(self) -> list[SavedLayer]:
        """Returns the layers with a weight matrix (units, inputs) and a bias (units,)."""
        return [layer for layer in self.layers if layer.kind == "linear"]

    def structure(self) -> list[tuple[str, Mapping[str, float], dict[str, tuple[int, ...]]]]:
        """Returns kind, numbers and shapes of each layer."""
        return [
            (layer.kind, layer.numbers, {name: array.shape for name, array in layer.arrays.items()})
            for layer in self.layers
        ]

    def act(self, observations: Array) -> Array:
        """Returns actions (..., action_size) for (..., size), of numpy or, for ONNX, of torch."""
        xp = array_namespace(observations)
        results = [xp.astype(observations, xp.float32, copy=False)]
        for layer in self.layers:
            values = results[-1]
            if layer.kind == _CONCAT:
                earlier = results[int(layer.numbers["earlier"])]
                results.append(xp.concat([earlier, values], axis=-1))
            else:
                arrays = {name: xp.asarray(array) for name, array in layer.arrays.items()}
                results.append(LAYERS[layer.kind](values, **arrays, **layer.numbers))
        return results[-1].clip(-1, 1)

    def files(self) -> tuple[bytes, bytes]:
        """Returns the arrays as safetensors, by names such as 0.weight, and the rest as JSON."""
        tensors = {
            f"{i}.{name}": np.ascontiguousarray(array)
            for i, layer in enumerate(self.layers)
            for name, array in layer.arrays.items()
        }
        described = {"network": [{"layer": layer.kind, **layer.numbers} for layer in self.layers]}
        return safetensors.numpy.save(tensors), json.dumps(described, indent=1).encode()

    @classmethod
    def from_files(cls, weights: bytes, description: bytes) -> "SavedNetwork":
        """Inverts `files`, and reads an older format; raises a ValueError if they are invalid."""
        try:
            tensors, described = safetensors.numpy.load(weights), json.loads(description)
            network = cls(
                [_layer(layer, i, tensors) for i, layer in enumerate(described["network"])]
                if "network" in described
                else _older_layers(described, tensors)
            )
            with np.errstate(all="ignore"):
                acted = network.act(np.zeros((1, network.inputs), np.float32))
        except _DAMAGE as error:
            raise ValueError(f"no policy: {error}") from None
        if acted.shape != (1, network.outputs):
            raise ValueError("no policy: a layer does not fit the layer before it")
        return network


def linear_layer(weight: Float, bias: Float) -> SavedLayer:
    """Returns a layer with a weight matrix (units, inputs) and a bias (units,)."""
    return SavedLayer("linear", {"weight": weight, "bias": bias})


def relu_layers(linear: Sequence[SavedLayer], squash: str) -> list[SavedLayer]:
    """Returns layers with ReLU between them and "tanh" or "clip" (to [-1, 1]) after the last."""
    last = {"tanh": SavedLayer("tanh"), "clip": SavedLayer("clip", numbers={"low": -1, "high": 1})}
    between = [layer for affine in linear for layer in (affine, SavedLayer("relu"))]
    return [*between[:-1], last[squash]]


def feature_layers(
    mean: Float, deviation: Float, linear: Sequence[SavedLayer], appended: bool
) -> list[SavedLayer]:
    """Returns densely connected layers of SiLU units on observations (size,) that are standardized.

    Args:
        linear: each takes the standardized observation and the units of the layers before it.
        appended: whether the features are the observation followed by the units, or the units.
    """
    layers = [
        SavedLayer("shift", {"offset": -mean}),
        SavedLayer("divide", {"divisor": deviation}),
        SavedLayer("clip", numbers={"low": -MAX_INPUT, "high": MAX_INPUT}),
    ]
    for layer in linear:
        inputs = SavedLayer(_CONCAT, numbers={"earlier": len(layers)})
        layers += [layer, SavedLayer("silu"), inputs]
    layers.append(SavedLayer("columns", numbers={"first": len(mean)}))
    return [*layers, SavedLayer(_CONCAT, numbers={"earlier": 0})] if appended else layers


def _layer(described: dict[str, Any], i: int, tensors: Mapping[str, Float]) -> SavedLayer:
    kind = described["layer"]
    names = ["earlier"] if kind == _CONCAT else inspect.signature(LAYERS[kind]).parameters
    arrays = {name: tensors[f"{i}.{name}"] for name in names if f"{i}.{name}" in tensors}
    return SavedLayer(
        kind,
        {name: np.asarray(array, np.float32) for name, array in arrays.items()},
        {name: float(described[name]) for name in names if name in described},
    )


def _older_layers(described: dict[str, Any], tensors: Mapping[str, Float]) -> list[SavedLayer]:
    """Returns the layers of the older format, which follow those of learned features if any."""

    def linear(prefix: str, count: int) -> list[SavedLayer]:
        names = [f"{prefix}{i}" for i in range(count)]
        return [linear_layer(tensors[f"{n}.weight"], tensors[f"{n}.bias"]) for n in names]

    layers = relu_layers(linear("", described["layers"]), described["squash"])
    features = described.get("features")
    if features is None:
        return layers
    standard = tensors["features.mean"], tensors["features.deviation"]
    units = linear("features.", features["layers"])
    return [*feature_layers(*standard, units, bool(features["appended"])), *layers]
