"""A fixed random projection: the control that any learned encoder must beat.

Source: Johnson and Lindenstrauss (1984). The projection does not depend on the data: it consists of
rows of a uniformly distributed random orthogonal matrix (Mezzadri, 2007). Least squares give a
linear decoder, so that a reconstruction error can be reported.
"""

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import ClosedForm, Weights
from jbench.encoders.moments import Moments, linear_decoder
from jbench.tasks.features import Array


class RandomProjection(ClosedForm):
    """Projects on random orthogonal directions; it has no options."""

    def fit(self, moments: Moments, latents: int, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the projection (latents, size) and the best linear decoder."""
        size = len(moments.mean)
        normal = np.random.default_rng(np.random.SeedSequence(seed)).normal(size=(size, size))
        rotation, triangle = np.linalg.qr(normal)
        # The first rows of one matrix, so that larger projections contain smaller ones.
        projection = (rotation * np.sign(np.diag(triangle))).T[:latents]
        # Constant features can leave directions without variance.
        decoder = linear_decoder(projection, moments.covariance, 1e-12)
        return {
            "projection": projection,
            "back": decoder,
            "mean": moments.mean - moments.mean @ projection.T @ decoder,
        }

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the projections."""
        return scaled @ weights["projection"].T

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction."""
        return latents @ weights["back"] + weights["mean"]
