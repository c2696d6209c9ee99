"""Fixed random tanh features, of which there may be more than there are features of the state.

Source: Rahimi and Recht (2007). The control for learned representations that are larger than the
observation: what does the mere number of inputs do?
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.kind import Fitted, Weights, tanh
from jbench.encoders.moments import Moments
from jbench.tasks.features import Array

if TYPE_CHECKING:
    from jbench.encoders.states import States

_MOST = 4096


class RandomFeatures(Fitted):
    """Tanh of random directions with random offsets; it has no options.

    Before the tanh a feature has a variance of 1 on average over the directions, and an offset
    between -1 and 1.
    """

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns 1 to 4096."""
        return range(1, _MOST + 1)

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        """Returns the directions (latents, size), the offsets, and the best linear way back."""
        random = np.random.default_rng(np.random.SeedSequence(states.seed))
        spread = np.sqrt(np.trace(states.learned.covariance))
        drawn = random.normal(size=(latents, states.size)) / spread
        weights = {
            "directions": drawn,
            "offsets": random.uniform(-1, 1, latents) - drawn @ states.learned.mean,
        }
        return weights | self._way_back(weights, next(states.learn()).states.cpu().numpy())

    def _way_back(
        self, weights: Weights, rows: NDArray[np.float32]
    ) -> dict[str, NDArray[np.float64]]:
        """Returns the least squares of some states (..., size) on their features."""
        latents, size = weights["directions"].shape
        moments = Moments.none(latents + size)
        for block in rows:
            moments = moments.merged(Moments.of(np.hstack([self.encode(weights, block), block])))
        covariance = moments.covariance
        inverse = np.linalg.pinv(covariance[:latents, :latents], rcond=1e-12, hermitian=True)
        back = inverse @ covariance[:latents, latents:]
        return {"back": back, "mean": moments.mean[latents:] - moments.mean[:latents] @ back}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the features, in (-1, 1)."""
        return tanh(scaled @ weights["directions"].T + weights["offsets"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns what least squares make of the features."""
        return latents @ weights["back"] + weights["mean"]
