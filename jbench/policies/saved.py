"""The kept policies of runs, usable without the library that trained them.

A policy is layers, which are applied with numpy, or with torch to export them.
"""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from jbench.arrays import Array, namespace
from jbench.encoders import Encoder, encoder_code, load_encoder, on_observations
from jbench.errors import RequestError, WorkError
from jbench.names import POLICY_FILES
from jbench.settings.records import EXTERNAL, Specs
from jbench.store import Record, Results
from jbench.store.code import check_code
from jbench.store.shipped import LEFT_OUT, results_to_read
from jbench.tasks.find import check_specs, code_provenance, find_task

Float = NDArray[np.float32]

WEIGHTS, DESCRIPTION = POLICY_FILES

MAX_INPUT = 10.0
"""Bound of the absolute value of an observation that learned features standardize."""

_CONCAT = "concat"
"""The kind of a layer that puts an earlier result before the last one. Its number `earlier` counts
the layers before that result: 0 for the observation."""


class SavedLayer:
    """A layer: its kind, one of `LAYERS`, with the arguments of its function."""

    def __init__(self, kind: str, **arguments: Float | float) -> None:
        """Has arrays and numbers by the names of the layer's arguments."""
        self.kind = kind
        self.arrays = dict[str, Float]()
        self.numbers = dict[str, float]()
        for name, value in arguments.items():
            if isinstance(value, np.ndarray):
                self.arrays[name] = value
            else:
                self.numbers[name] = value


def _layer_norm(x: Array, weight: Array, bias: Array, epsilon: float) -> Array:
    """Normalizes over the last axis."""
    centered = x - x.mean(axis=-1, keepdims=True)
    variance = (centered * centered).mean(axis=-1, keepdims=True)
    return centered / namespace(x).sqrt(variance + epsilon) * weight + bias


def _sigmoid(x: Array) -> Array:
    """The logistic function."""
    return 0.5 + 0.5 * namespace(x).tanh(0.5 * x)  # does not overflow


def _elu(x: Array, alpha: float) -> Array:
    """The exponential linear unit."""
    xp = namespace(x)
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
    "tanh": lambda x: namespace(x).tanh(x),
    "sigmoid": _sigmoid,
    "silu": lambda x: x * _sigmoid(x),
    "elu": _elu,
    "leaky_relu": lambda x, slope: namespace(x).where(x > 0, x, slope * x),
    _CONCAT: lambda x, earlier: namespace(x).concat([earlier, x], axis=-1),
}
"""The function of each kind of layer, of the result of the layer before it."""


@dataclass(frozen=True)
class SavedNetwork:
    """A deterministic policy: layers applied one after another, then clipped to [-1, 1]."""

    layers: Sequence[SavedLayer]

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of inputs and outputs."""
        weights = [layer.arrays["weight"] for layer in self.linear_layers()]
        return weights[0].shape[1], weights[-1].shape[0]

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
        xp = namespace(observations)
        results = [xp.astype(observations, xp.float32, copy=False)]
        for layer in self.layers:
            arguments: dict[str, Any] = {n: xp.asarray(array) for n, array in layer.arrays.items()}
            arguments |= layer.numbers
            if layer.kind == _CONCAT:
                arguments["earlier"] = results[int(arguments["earlier"])]
            results.append(LAYERS[layer.kind](results[-1], **arguments))

        return results[-1].clip(-1, 1)

    def files(self) -> dict[str, bytes]:
        """Returns the arrays as safetensors, by names such as 0.weight, and the rest as JSON."""
        tensors = {
            f"{i}.{name}": np.ascontiguousarray(array)
            for i, layer in enumerate(self.layers)
            for name, array in layer.arrays.items()
        }
        described = {"network": [{"layer": layer.kind, **layer.numbers} for layer in self.layers]}
        weights = safetensors.numpy.save(tensors)
        description = json.dumps(described, indent=1)
        return {WEIGHTS: weights, DESCRIPTION: description.encode()}

    @classmethod
    def from_files(cls, weights: bytes, description: bytes) -> "SavedNetwork":
        """Inverts `files`, and reads an older format; raises a ValueError if they are invalid."""
        try:
            tensors = safetensors.numpy.load(weights)
            described = json.loads(description)
            network = cls(
                [_layer(layer, i, tensors) for i, layer in enumerate(described["network"])]
                if "network" in described
                else _older_layers(described, tensors)
            )
            with np.errstate(all="ignore"):
                acted = network.act(np.zeros((1, network.sizes[0]), np.float32))
        except Exception as error:  # of any type, since the files may be damaged
            raise ValueError(f"no policy: {error}") from None

        if acted.shape != (1, network.sizes[1]):
            raise ValueError("no policy: a layer does not fit the layer before it")

        return network


def relu_layers(linear: Sequence[SavedLayer], squash: str) -> list[SavedLayer]:
    """Returns layers with ReLU between them and "tanh" or "clip" (to [-1, 1]) after the last."""
    last = {"tanh": SavedLayer("tanh"), "clip": SavedLayer("clip", low=-1, high=1)}
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
        SavedLayer("shift", offset=-mean),
        SavedLayer("divide", divisor=deviation),
        SavedLayer("clip", low=-MAX_INPUT, high=MAX_INPUT),
    ]
    for layer in linear:
        layers += [layer, SavedLayer("silu"), SavedLayer(_CONCAT, earlier=len(layers))]

    layers.append(SavedLayer("columns", first=len(mean)))
    return [*layers, SavedLayer(_CONCAT, earlier=0)] if appended else layers


def _layer(described: dict[str, Any], i: int, tensors: Mapping[str, Float]) -> SavedLayer:
    """Returns a layer from its description and the tensors of a file."""
    kind = described["layer"]
    names = [*inspect.signature(LAYERS[kind]).parameters][1:]
    arguments = {n: described[n] if n in described else tensors[f"{i}.{n}"] for n in names}
    return SavedLayer(kind, **arguments)


def _older_layers(described: dict[str, Any], tensors: Mapping[str, Float]) -> list[SavedLayer]:
    """Returns the layers of the older format, which follow those of learned features if any."""

    def linear(prefix: str, count: int) -> list[SavedLayer]:
        parts = [[tensors[f"{prefix}{i}.{n}"] for n in ("weight", "bias")] for i in range(count)]
        return [SavedLayer("linear", weight=weight, bias=bias) for weight, bias in parts]

    layers = relu_layers(linear("", described["layers"]), described["squash"])
    if (features := described.get("features")) is None:
        return layers

    before = feature_layers(
        tensors["features.mean"],
        tensors["features.deviation"],
        linear("features.", features["layers"]),
        bool(features["appended"]),
    )
    return [*before, *layers]


@dataclass(frozen=True)
class TrainedAgent:
    """The policy of a finished run together with its encoder."""

    task: str
    policy: SavedNetwork
    encoder: Encoder | None

    def act(self, observations: Array) -> Array:
        """Returns actions (..., action_size) for observations (..., dim(O)), or a RequestError."""
        size = find_task(self.task).observation_size
        if observations.shape[-1:] != (size,):
            raise RequestError(
                f"The agent was trained on {self.task}: pass observations of the shape "
                f"(..., {size}), not {observations.shape}."
            )
        return on_observations(self.encoder, self.policy.act)(observations)


def has_policy(record: Record) -> bool:
    """Returns whether a run was saved with its policy; most shipped runs were not."""
    return {WEIGHTS, DESCRIPTION} <= {entry.name for entry in record.manifest.files}


def agent_code(results: Results, record: Record) -> dict[str, Any]:
    """Returns provenance of the present users' code that runs a saved policy: task and encoder.

    Its layers run without the code that has trained them.
    """
    task = record.settings.get("task")
    encoder = record.settings.get("encoder")
    return {**code_provenance(str(task)), **encoder_code(results, encoder)}


def load_agent(
    results: Results | Path | str, run: str, accept_changed: bool = False
) -> TrainedAgent:
    """Returns the trained agent of a finished run, by its whole id; see `results_to_read`.

    Raises a RequestError if the run does not exist, has not finished, or was saved without its
    policy, its task is not installed, or the code of task or encoder has changed, unless that is
    accepted, and a WorkError if its files are damaged.
    """
    results = results_to_read(results)
    record = results.find("run", run)
    if record is None:
        raise results.no_run(run)
    if record.status != "finished":
        raise RequestError(f"The run {run} is {record.status}: it has no trained policy yet.")

    if not has_policy(record):
        recorded = record.settings.get("engine") == EXTERNAL
        keep = " Its loop must call recording.keep_policy(actor)." if recorded else ""
        if record.left_out:
            raise RequestError(f"The policy of {run} {LEFT_OUT}.")
        raise RequestError(f"The run {run} in {results.name} was saved without its policy.{keep}")

    try:
        policy = SavedNetwork.from_files(*map(record.read_file, (WEIGHTS, DESCRIPTION)))
    except ValueError as error:
        raise WorkError(f"The policy of {run} can't be read ({error}).") from None

    task, encoder = (record.settings.get(name, 0) for name in ("task", "encoder"))
    if not isinstance(task, str) or not isinstance(encoder, str | None):
        raise WorkError(f"The settings of the run {run} lack a task or an encoder.")
    if not accept_changed:
        check_code(record, agent_code(results, record))

    specs = record.settings.get("specs")
    check_specs(task, Specs.model_validate(specs) if specs else None, accept_changed)
    loaded = None if encoder is None else load_encoder(results, encoder, accept_changed)[0]
    return TrainedAgent(task, policy, loaded)
