"""Inputs of agents that are standardized by running statistics."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from jbench.policies.layer_sequences import standardizing_layers
from jbench.policies.layers import Divide, Shift
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import AlgorithmSettings

_LAYERS = 3
"""Number of the layers with which a saved policy standardizes its inputs."""


class Standardization(NamedTuple):
    """What standardizes inputs (..., N, size) of one seed, or of the seeds of a stack.

    Attributes:
        mean: (..., 1, size).
        deviation: (..., 1, size), the standard deviation.
        clip: bound of the absolute value of standardized inputs.
    """

    mean: Tensor
    deviation: Tensor
    clip: float

    def apply(self, inputs: Tensor) -> Tensor:
        """Returns standardized inputs, as new tensors."""
        return torch.sub(inputs, self.mean).div_(self.deviation).clamp_(-self.clip, self.clip)

    def apply_in_place(self, inputs: Tensor) -> None:
        """Standardizes inputs in place, with the same bits as `apply`."""
        inputs.sub_(self.mean).div_(self.deviation).clamp_(-self.clip, self.clip)


class RunningStatistics:
    """Mean and variance of the observations on which the agent of each seed has acted.

    They start as those of `normalize_start_count` observations with mean 0 and variance 1. Sources:
    VecNormalize of stable-baselines3, which starts with 1e-4 of them, and the class RunningMeanStd
    of stable-baselines 2, whose sum 0, sum of squares 0.01 and count 0.01 are 0.01 of them.

    They are counted in float64 where the robots are, on the CPU. What the agents see follows from
    them, in the precision of the agents: tensors with fixed addresses, which the updates read, on a
    GPU from recorded graphs.

    Attributes:
        mean, variance: (seeds, size) float64.
        count: (seeds,) float64, the number of observations, with those of the start.
    """

    def __init__(
        self,
        settings: AlgorithmSettings,
        seeds: int,
        size: int,
        *,
        dtype: torch.dtype,
        device: torch.device,
    ) -> None:
        """Starts the statistics of inputs with `size` numbers."""
        self.mean = np.zeros((seeds, size))
        self.variance = np.ones((seeds, size))
        self._start_count = settings.normalize_start_count
        self.count = np.full(seeds, self._start_count)
        self._min_variance = settings.normalize_min_sd**2
        self._epsilon = settings.normalize_epsilon
        self._clip = settings.normalize_clip
        self._shown_mean = torch.zeros(seeds, 1, size, dtype=dtype)
        self._shown_deviation = torch.ones(seeds, 1, size, dtype=dtype)
        # On a CPU, these are the same tensors.
        self._device_mean = self._shown_mean.to(device)
        self._device_deviation = self._shown_deviation.to(device)
        self._show()

    def add(self, observations: Tensor) -> None:
        """Counts observations (seeds, environments, size), one environment after another.

        With d = o - mean: mean <- mean + d / n, and variance <- (n - 1) / n (variance + d^2 / n)
        (Welford, 1962). A seed's numbers do not depend on the other seeds.
        """
        for rows in observations.numpy().astype(np.float64).swapaxes(0, 1):
            before = self.count[:, None].copy()
            self.count += 1
            difference = rows - self.mean
            step = difference / self.count[:, None]
            self.mean += step
            self.variance += difference * step
            self.variance *= before / self.count[:, None]
        self._show()

    def standardization(self) -> Standardization:
        """Returns what standardizes the inputs (seeds, N, size) of all agents, on the CPU."""
        return Standardization(self._shown_mean, self._shown_deviation, self._clip)

    def group_standardization(self, seeds: range, *, is_stack: bool) -> Standardization:
        """Returns what standardizes minibatches of a group of seeds, on their device.

        `send` brings it up to date.
        """
        mean, deviation = (
            values[seeds.start : seeds.stop] if is_stack else values[seeds.start]
            for values in (self._device_mean, self._device_deviation)
        )
        return Standardization(mean, deviation, self._clip)

    def send(self) -> None:
        """Copies what the agents see to their device, in place."""
        if self._device_mean is not self._shown_mean:
            self._device_mean.copy_(self._shown_mean)
            self._device_deviation.copy_(self._shown_deviation)

    def state(self, seed: int) -> dict[str, Tensor]:
        """Returns the statistics of one seed by name."""
        return {
            "mean": torch.from_numpy(self.mean[seed].copy()),
            "variance": torch.from_numpy(self.variance[seed].copy()),
            "count": torch.tensor(self.count[seed]),
        }

    def restore(self, seed: int, tensors: dict[str, Tensor]) -> None:
        """Restores what `state` returned, bit for bit."""
        self.mean[seed] = tensors["mean"].numpy()
        self.variance[seed] = tensors["variance"].numpy()
        self.count[seed] = tensors["count"].item()
        self._show()

    def with_layers(self, seed: int, policy: SavedNetwork) -> SavedNetwork:
        """Returns a policy whose first layers standardize its inputs as those of the seed now."""
        mean, deviation = (
            values[seed, 0].float().numpy().copy()
            for values in (self._shown_mean, self._shown_deviation)
        )
        layers = standardizing_layers(mean, deviation, self._clip)
        return SavedNetwork([*layers, *policy.layers])

    def load_layers(self, seed: int, policy: SavedNetwork, observations: int) -> SavedNetwork:
        """Sets the statistics of a seed from its saved policy, which has seen `observations`.

        The seed then sees the same bits as the policy. Returns the rest of the policy. The variance
        of a number whose deviation was below `normalize_min_sd` is not saved; it becomes the least.
        """
        center, scale = policy.layers[:2]
        assert isinstance(center, Shift)
        assert isinstance(scale, Divide)
        self.mean[seed] = -center.offset.astype(np.float64)
        deviation = scale.divisor.astype(np.float64)
        self.variance[seed] = np.maximum(deviation**2 - self._epsilon, 0)
        self.count[seed] = self._start_count + observations
        self._show()
        return SavedNetwork(policy.layers[_LAYERS:])

    def _show(self) -> None:
        """Computes what the agents see: sd = sqrt(max(variance, least) + epsilon)."""
        deviation = np.maximum(self.variance, self._min_variance)
        deviation += self._epsilon
        np.sqrt(deviation, out=deviation)
        self._shown_mean[:, 0].copy_(torch.from_numpy(self.mean))
        self._shown_deviation[:, 0].copy_(torch.from_numpy(deviation))


def running_statistics(
    settings: AlgorithmSettings, seeds: int, size: int, dtype: torch.dtype, device: torch.device
) -> RunningStatistics | None:
    """Returns statistics if the settings standardize inputs, else None."""
    if settings.normalize == "none":
        return None
    return RunningStatistics(settings, seeds, size, dtype=dtype, device=device)
