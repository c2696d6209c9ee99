"""Learned features of a saved policy, evaluated with numpy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_INPUT = 10.0
"""Bound of the absolute value of standardized observations."""

MIN_DEVIATION = 1e-3
"""Its square is added to a variance, so that constant observations can be standardized."""


@dataclass(frozen=True)
class FeatureMap:
    """Densely connected layers of SiLU units on standardized observations.

    Attributes:
        mean: (size,) mean of the observations.
        deviation: (size,) standard deviation of the observations.
        weights: a (units, inputs) matrix per layer.
        biases: a (units,) vector per layer.
        appended: whether the features are the observation followed by the units, or only the units.
    """

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    weights: list[NDArray[np.float32]]
    biases: list[NDArray[np.float32]]
    appended: bool

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the features (..., features) of observations (..., size)."""
        values = np.clip((observations - self.mean) / self.deviation, -MAX_INPUT, MAX_INPUT)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            raw = values @ weight.T + bias
            # SiLU, with the logistic function as a tanh, which does not overflow.
            units = raw * (0.5 + 0.5 * np.tanh(0.5 * raw))
            values = np.concatenate([values, units], axis=-1)
        units = values[..., len(self.mean) :]
        return np.concatenate([observations, units], axis=-1) if self.appended else units

    def tensors(self) -> dict[str, NDArray[np.float32]]:
        """Returns the arrays by name, for safetensors."""
        arrays = {"features.mean": self.mean, "features.deviation": self.deviation}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"features.{i}.weight": weight, f"features.{i}.bias": bias}
        return arrays

    def description(self) -> dict[str, int | bool]:
        """Returns the structure that the tensors do not contain, for JSON."""
        return {"layers": len(self.weights), "appended": self.appended}

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, NDArray[np.float32]], description: dict[str, int | bool]
    ) -> "FeatureMap":
        """Inverts `tensors` and `description`.

        Raises:
            KeyError: if an entry is missing.
        """
        layers = range(description["layers"])
        return cls(
            tensors["features.mean"],
            tensors["features.deviation"],
            [tensors[f"features.{i}.weight"] for i in layers],
            [tensors[f"features.{i}.bias"] for i in layers],
            bool(description["appended"]),
        )
