"""The observation in SI units, without any scaling.

It is the control for the nominal scaling of the tasks' observations, which the authors' environment
did not have before September 2019. The motor speed then varies by 180 and the quaternion by 1.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import Fitted, Weights
from jbench.encoders.kinds.planar import physical_scaling
from jbench.tasks.features import TASK_SPECS, Array

if TYPE_CHECKING:
    from jbench.encoders.states import States


class Raw(Fitted):
    """Returns all features in SI units."""

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the number of features of the task."""
        size = TASK_SPECS[task].observation_size
        return range(size, size + 1)

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        """Returns gain and offset of each feature."""
        gain, offset = physical_scaling(states.task, states.scaling)
        inverse = np.divide(1, gain, out=np.zeros_like(gain), where=gain != 0)
        return {"gain": gain, "offset": offset, "inverse": inverse}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the features in SI units."""
        return scaled * weights["gain"] + weights["offset"]

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the scaled features."""
        return (latents - weights["offset"]) * weights["inverse"]
