"""Saved policies: a few matrices, usable without the library that trained them."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import NDArray

from jbench.encoders import Encoder, load_encoder, on_observations
from jbench.errors import RequestError, WorkError
from jbench.policies.feature_map import FeatureMap
from jbench.policies.network import Network
from jbench.settings.records import EXTERNAL, Specs
from jbench.simulation.find import check_specs, find_task
from jbench.store import Record, Results
from jbench.store.shipped import results_to_read
from jbench.wording import with_results

WEIGHTS = "policy.safetensors"
DESCRIPTION = "policy.json"

_SQUASHES: dict[str, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {
    "tanh": np.tanh,
    "clip": lambda raw: np.clip(raw, -1, 1),
}


@dataclass(frozen=True)
class Policy:
    """A deterministic policy: layers of ReLU units and an output squashed into [-1, 1].

    Attributes:
        weights: a (units, inputs) matrix per layer.
        biases: a (units,) vector per layer.
        squash: "tanh" or "clip".
        features: inputs of the first layer; None for observations.
    """

    weights: list[NDArray[np.float32]]
    biases: list[NDArray[np.float32]]
    squash: str
    features: FeatureMap | None = None

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns actions (..., action_size) for (encoded) observations (..., size)."""
        values = observations if self.features is None else self.features(observations)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.maximum(values @ weight.T + bias, 0)
        return _SQUASHES[self.squash](values @ self.weights[-1].T + self.biases[-1])

    def tensors(self) -> dict[str, NDArray[np.float32]]:
        """Returns the arrays by name, such as 0.weight, for safetensors."""
        tensors = {} if self.features is None else self.features.tensors()
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            tensors |= {f"{layer}.weight": weight, f"{layer}.bias": bias}
        return tensors

    def description(self) -> dict[str, Any]:
        """Returns the structure that the tensors do not contain, for JSON."""
        structure: dict[str, Any] = {"layers": len(self.weights), "squash": self.squash}
        if self.features is not None:
            structure["features"] = self.features.description()
        return structure

    @classmethod
    def from_files(cls, weights: bytes, description: bytes) -> "Policy":
        """Inverts `tensors` (as safetensors) and `description` (as JSON).

        Raises:
            ValueError: if the files are invalid.
        """
        try:
            layout = json.loads(description)
            features = layout.get("features")
            tensors = safetensors.numpy.load(weights)
            policy = cls(
                [tensors[f"{layer}.weight"] for layer in range(layout["layers"])],
                [tensors[f"{layer}.bias"] for layer in range(layout["layers"])],
                layout["squash"],
                None if features is None else FeatureMap.from_tensors(tensors, features),
            )
        except (safetensors.SafetensorError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"no policy: {error}") from None
        if not policy.weights or policy.squash not in _SQUASHES:
            raise ValueError("no policy: no layers, or an unknown squash")
        return policy


def policy_files(policy: Policy | Network | None) -> dict[str, bytes]:
    """Returns a policy as files by name; none for None."""
    if policy is None:
        return {}
    return {
        WEIGHTS: safetensors.numpy.save(policy.tensors()),
        DESCRIPTION: json.dumps(policy.description(), indent=1).encode(),
    }


@dataclass(frozen=True)
class TrainedAgent:
    """The policy of a finished run together with its encoder."""

    task: str
    policy: Policy | Network
    encoder: Encoder | None

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns actions (..., action_size) for observations (..., dim(O)) of the task.

        Raises:
            RequestError: if the observations have another size.
        """
        size = find_task(self.task).observation_size
        # ONNX models are made from a traced array, which has no shape.
        if isinstance(observations, np.ndarray) and observations.shape[-1:] != (size,):
            raise RequestError(
                f"The agent was trained on {self.task}: pass observations of the shape "
                f"(..., {size}), not {observations.shape}."
            )
        actions: NDArray[np.float32] = on_observations(self.encoder, self.policy.act)(observations)
        return actions


def has_policy(record: Record) -> bool:
    """Returns whether a run was saved with its policy; most shipped runs were not."""
    return {WEIGHTS, DESCRIPTION} <= {entry.name for entry in record.manifest.files}


def load_agent(results: Results | Path | str, run: str) -> TrainedAgent:
    """Returns the trained agent of a finished run.

    Args:
        results: the results or their directory; "reference" names the shipped ones.
        run: the whole id of the run.

    Raises:
        RequestError: if the run does not exist, has not finished, or was saved without its policy,
            or its task is not installed or has changed.
        WorkError: if its files are damaged.
    """
    results = results_to_read(results)
    record = results.find("run", run)
    if record is None:
        runs = with_results("jbench runs", results.name)
        raise RequestError(f"No run {run} in {results.name}; {runs} lists them.")
    if record.status != "finished":
        raise RequestError(f"The run {run} is {record.status}: it has no trained policy yet.")
    if not has_policy(record):
        recorded = record.settings.get("engine") == EXTERNAL
        keep = " Its loop must call recording.keep_policy(actor)." if recorded else ""
        raise RequestError(f"The run {run} in {results.name} was saved without its policy.{keep}")
    description = record.read_file(DESCRIPTION)
    # Policies of recorded training loops and of other packages are networks.
    kind = Network if b'"network"' in description else Policy
    try:
        policy = kind.from_files(record.read_file(WEIGHTS), description)
    except ValueError as error:
        raise WorkError(f"The policy of {run} can't be read ({error}).") from None
    task, encoder = (record.settings.get(name, 0) for name in ("task", "encoder"))
    if not isinstance(task, str) or not isinstance(encoder, str | None):
        raise WorkError(f"The settings of the run {run} lack a task or an encoder.")
    specs = record.settings.get("specs")
    check_specs(task, None if specs is None else Specs.model_validate(specs))
    return TrainedAgent(
        task, policy, None if encoder is None else load_encoder(results, encoder)[0]
    )
