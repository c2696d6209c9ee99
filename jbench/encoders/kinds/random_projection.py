"""A fixed random projection: the control that any learned encoder must beat.

Source: Johnson and Lindenstrauss (1984). The projection is drawn without looking at the data: the
rows of a random orthogonal matrix, uniform among them all (Mezzadri, 2007). The way back is the
linear one of least squares, so that an error can be told.
"""

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import ClosedForm, Weights
from jbench.encoders.moments import Moments
from jbench.tasks.features import Array


class RandomProjection(ClosedForm):
    """Projects on random orthogonal directions; it has no options."""

    def fit(self, moments: Moments, latents: int, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the projection (latents, size) and the best linear way back."""
        size = len(moments.mean)
        drawn = np.random.default_rng(np.random.SeedSequence(seed)).normal(size=(size, size))
        rotation, triangle = np.linalg.qr(drawn)
        # All of one matrix, cut short: more latents keep the directions of fewer.
        projection = (rotation * np.sign(np.diag(triangle))).T[:latents]
        seen = projection @ moments.covariance
        # A feature that never changes may leave directions without any variance.
        back = np.linalg.pinv(seen @ projection.T, rcond=1e-12, hermitian=True) @ seen
        return {
            "projection": projection,
            "back": back,
            "mean": moments.mean - moments.mean @ projection.T @ back,
        }

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the projections."""
        return scaled @ weights["projection"].T

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns what least squares make of the projections."""
        return latents @ weights["back"] + weights["mean"]
