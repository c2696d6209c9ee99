"""Principal component analysis, exact and in closed form.

Source: Pearson (1901), Hotelling (1933). It is the best linear encoder and decoder: the
eigenvectors of the covariance with the largest eigenvalues.
"""

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import ClosedForm, Weights
from jbench.encoders.moments import Moments
from jbench.tasks.features import Array


class PrincipalComponents(ClosedForm):
    """Projects on the directions of the largest variance; it has no options."""

    def fit(self, moments: Moments, latents: int, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the components (latents, size) in order of decreasing variance, and the mean."""
        _, vectors = np.linalg.eigh(moments.covariance)
        components = vectors[:, ::-1][:, :latents].T
        # An eigenvector's sign is arbitrary: its largest component is made positive.
        largest = np.argmax(np.abs(components), axis=1)
        signs = np.sign(components[np.arange(latents), largest])
        return {"components": components * signs[:, None], "mean": moments.mean}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the coordinates along the components."""
        return (scaled - weights["mean"]) @ weights["components"].T

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction."""
        return latents @ weights["components"] + weights["mean"]
