"""Fixed random tanh features, whose number may exceed the size of the observation.

Source: Rahimi and Recht (2007). They are the control for learned representations that are larger
than the observation: they show the effect of the number of inputs alone.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import Fitted, Weights, tanh
from jbench.encoders.moments import Moments
from jbench.tasks.features import Array

if TYPE_CHECKING:
    from jbench.encoders.states import States

_MAX_LATENTS = 4096


class RandomFeatures(Fitted):
    """Tanh of random directions with random offsets; it has no options.

    The argument of the tanh has unit variance on average over the directions, and an offset between
    -1 and 1.
    """

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns 1 to 4096."""
        return range(1, _MAX_LATENTS + 1)

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        """Returns the directions (latents, size), the offsets, and the best linear decoder."""
        random = np.random.default_rng(np.random.SeedSequence(states.seed))
        sd = np.sqrt(np.trace(states.learned.covariance))
        directions = random.normal(size=(latents, states.size)) / sd
        weights = {
            "directions": directions,
            "offsets": random.uniform(-1, 1, latents) - directions @ states.learned.mean,
        }
        return weights | self._linear_decoder(weights, next(states.learn()).states.cpu().numpy())

    def _linear_decoder(
        self, weights: Weights, rows: NDArray[np.float32]
    ) -> dict[str, NDArray[np.float64]]:
        """Returns the least squares regression of states (..., size) on their features."""
        latents, size = weights["directions"].shape
        moments = Moments.none(latents + size)
        for block in rows:
            moments = moments.merged(Moments.of(np.hstack([self.encode(weights, block), block])))
        covariance = moments.covariance
        inverse = np.linalg.pinv(covariance[:latents, :latents], rcond=1e-12, hermitian=True)
        decoder = inverse @ covariance[:latents, latents:]
        return {"back": decoder, "mean": moments.mean[latents:] - moments.mean[:latents] @ decoder}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the features, in (-1, 1)."""
        return tanh(scaled @ weights["directions"].T + weights["offsets"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction."""
        return latents @ weights["back"] + weights["mean"]
