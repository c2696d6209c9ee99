"""The identity on scaled features: the control for the scaling of the other kinds.

Encoders scale each feature to [-1, 1] before they reduce them, so an agent on latents and an agent
on observations also differ in the scale of their inputs. This kind scales without reducing.
"""

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import ClosedForm, Weights
from jbench.encoders.moments import Moments
from jbench.simulation import find_task
from jbench.tasks.features import Array


class Scaled(ClosedForm):
    """Returns the scaled features; it has no options and no weights."""

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the number of features of the task."""
        size = find_task(task).observation_size
        return range(size, size + 1)

    def fit(self, moments: Moments, latents: int, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns no weights."""
        return {}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the scaled features."""
        return scaled

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the scaled features."""
        return latents
