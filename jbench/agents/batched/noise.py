"""Action noise for exploration."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.generators import Generators
from jbench.settings.algorithms import OffPolicySettings


class ActionNoise:
    """Normal or Ornstein-Uhlenbeck noise for each robot of each seed.

    Attributes:
        previous: (seeds, environments, action_size) state of the process; zeros for normal noise.
    """

    def __init__(self, settings: OffPolicySettings, shape: tuple[int, int, int]) -> None:
        """Starts the processes at 0; the shape is (seeds, environments, action_size)."""
        self._kind = settings.action_noise
        self._mean, self._sigma = settings.noise_mean, settings.noise_sigma
        self._pull = settings.noise_theta * settings.noise_dt
        self._step = settings.noise_sigma * math.sqrt(settings.noise_dt)
        self.previous = np.zeros(shape)

    def reset(self) -> None:
        """Restarts the processes at the beginning of an episode."""
        self.previous[:] = 0

    def draw(self, generators: Sequence[Generators]) -> NDArray[np.float64] | float:
        """Returns the next noise (seeds, environments, action_size); 0 if there is none."""
        if self._kind == "none":
            return 0.0
        shape = self.previous.shape[1:]
        normal = np.stack([each.actions.standard_normal(shape) for each in generators])
        if self._kind == "normal":
            return self._mean + self._sigma * normal
        self.previous += self._pull * (self._mean - self.previous) + self._step * normal
        return self.previous
