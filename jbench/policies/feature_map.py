"""Features that were learned with an agent, as its saved policy has them: numpy alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LARGEST = 10.0
"""Standardised observations are clipped to plus and minus this."""

SMALLEST_DEVIATION = 1e-3
"""Added in square to a variance, so that a constant observation can be standardised."""


@dataclass(frozen=True)
class FeatureMap:
    """Layers of SiLU units, each of which sees the standardised observation and all units before.

    Attributes:
        mean: (size,) of the observations.
        deviation: (size,) by which they are divided.
        weights: a (units, inputs) matrix for each layer.
        biases: a (units,) vector for each layer.
        appended: whether the features are the observation and behind it the units, or the units
            alone.
    """

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    weights: list[NDArray[np.float32]]
    biases: list[NDArray[np.float32]]
    appended: bool

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the features (..., features) of observations (..., size)."""
        values = np.clip((observations - self.mean) / self.deviation, -LARGEST, LARGEST)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            raw = values @ weight.T + bias
            # SiLU; the logistic function by tanh, which does not overflow.
            units = raw * (0.5 + 0.5 * np.tanh(0.5 * raw))
            values = np.concatenate([values, units], axis=-1)
        units = values[..., len(self.mean) :]
        return np.concatenate([observations, units], axis=-1) if self.appended else units

    def tensors(self) -> dict[str, NDArray[np.float32]]:
        """Returns its numbers by name, for safetensors."""
        found = {"features.mean": self.mean, "features.deviation": self.deviation}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            found |= {f"features.{i}.weight": weight, f"features.{i}.bias": bias}
        return found

    def description(self) -> dict[str, int | bool]:
        """Returns what its tensors do not say, for JSON."""
        return {"layers": len(self.weights), "appended": self.appended}

    @classmethod
    def from_tensors(
        cls, tensors: dict[str, NDArray[np.float32]], description: dict[str, int | bool]
    ) -> "FeatureMap":
        """Returns what `tensors` and `description` were made of.

        Raises:
            KeyError: if something is missing.
        """
        layers = range(description["layers"])
        return cls(
            tensors["features.mean"],
            tensors["features.deviation"],
            [tensors[f"features.{i}.weight"] for i in layers],
            [tensors[f"features.{i}.bias"] for i in layers],
            bool(description["appended"]),
        )
