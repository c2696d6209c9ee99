"""Policies as layers, and the two files that keep them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import safetensors.numpy

from jbench.array_types import Float32Array
from jbench.arrays import Array, namespace
from jbench.names import POLICY_FILES
from jbench.policies.layer_sequences import feature_layers, relu_layers
from jbench.policies.layers import LAYERS, Linear, SavedLayer

WEIGHTS, DESCRIPTION = POLICY_FILES


@dataclass(frozen=True)
class SavedNetwork:
    """A deterministic policy: layers applied one after another, then clipped to [-1, 1]."""

    layers: Sequence[SavedLayer]

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of inputs and outputs."""
        weights = [layer.weight for layer in self.linear_layers()]
        return weights[0].shape[1], weights[-1].shape[0]

    def linear_layers(self) -> list[Linear]:
        """Returns the layers that have a weight matrix."""
        return [layer for layer in self.layers if isinstance(layer, Linear)]

    def structure(self) -> list[tuple[str, Mapping[str, float], dict[str, tuple[int, ...]]]]:
        """Returns kind, numbers and shapes of each layer."""
        return [
            (layer.kind, layer.numbers, {name: array.shape for name, array in layer.arrays.items()})
            for layer in self.layers
        ]

    def act(self, observations: Array) -> Array:
        """Returns actions (..., action_size) for (..., size), of numpy or, for ONNX, of torch."""
        xp = namespace(observations)
        results = [xp.astype(observations, xp.float32, copy=False)]
        for layer in self.layers:
            results.append(layer.after(results))

        return results[-1].clip(-1, 1)

    def files(self) -> dict[str, bytes]:
        """Returns the arrays as safetensors, by names such as 0.weight, and the rest as JSON."""
        tensors = {}
        for i, layer in enumerate(self.layers):
            for name, array in layer.arrays.items():
                tensors[f"{i}.{name}"] = np.ascontiguousarray(array)

        described = {"network": [{"layer": layer.kind, **layer.numbers} for layer in self.layers]}
        weights = safetensors.numpy.save(tensors)
        description = json.dumps(described, indent=1)
        return {WEIGHTS: weights, DESCRIPTION: description.encode()}

    @classmethod
    def from_files(cls, weights: bytes, description: bytes) -> "SavedNetwork":
        """Inverts `files`, and reads an older format; raises a ValueError if they are invalid."""
        try:
            tensors = safetensors.numpy.load(weights)
            network = cls(_read_layers(json.loads(description), tensors))
            with np.errstate(all="ignore"):
                acted = network.act(np.zeros((1, network.sizes[0]), np.float32))
        except Exception as error:  # of any type, since the files may be damaged
            raise ValueError(f"no policy: {error}") from None

        if acted.shape != (1, network.sizes[1]):
            raise ValueError("no policy: a layer does not fit the layer before it")

        return network


def _read_layers(
    described: dict[str, Any], tensors: Mapping[str, Float32Array]
) -> list[SavedLayer]:
    """Returns the layers of a policy from its description and the tensors of its files."""
    if "network" not in described:
        return _read_older_layers(described, tensors)

    layers = []
    for i, layer in enumerate(described["network"]):
        layer_class = LAYERS[layer["layer"]]
        values = {}
        for name in (field.name for field in fields(layer_class)):
            if name in layer:
                values[name] = layer[name]
            else:
                values[name] = tensors[f"{i}.{name}"]

        layers.append(layer_class(**values))

    return layers


def _read_older_layers(
    described: dict[str, Any], tensors: Mapping[str, Float32Array]
) -> list[SavedLayer]:
    """Returns the layers of the older format, which follow those of learned features if any."""
    linear = _read_older_linear("", described["layers"], tensors)
    layers = relu_layers(linear, described["squash"])
    features = described.get("features")
    if features is None:
        return layers

    before = feature_layers(
        tensors["features.mean"],
        tensors["features.deviation"],
        _read_older_linear("features.", features["layers"], tensors),
        bool(features["appended"]),
    )
    return [*before, *layers]


def _read_older_linear(
    prefix: str, count: int, tensors: Mapping[str, Float32Array]
) -> list[Linear]:
    """Returns the linear layers whose tensors have a prefix and a number in their names."""
    return [
        Linear(weight=tensors[f"{prefix}{i}.weight"], bias=tensors[f"{prefix}{i}.bias"])
        for i in range(count)
    ]
