"""Dynamic mode decomposition with control, independent of the units of the features.

A linear model x' = A x + B u + noise of the scaled states x and the actions u is fitted by least
squares (Proctor, Brunton and Kutz, arXiv:1409.6358). Plain decomposition truncates A to the
directions of the largest variance, which depend on the features' units. Here x and x' are whitened
first. The singular values of A are then the canonical correlations of present and future given the
actions (Hotelling, 1936): numbers from 0 to 1 that no invertible linear change of the features
alters. The number of large ones is the order of the linear dynamics. The latents are the first
canonical directions of the present, of unit variance. Among all linear encoders of that size they
give the best linear prediction of the whitened future.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from jbench.encoders.kind import Fitted, Weights
from jbench.encoders.kinds.linear import Linear
from jbench.encoders.moments import FloatArray, Moments, linear_decoder, with_positive_largest
from jbench.names import EPISODE_STEPS
from jbench.tasks.geometry import Array

if TYPE_CHECKING:
    from jbench.encoders.states import States

_MIN_VARIANCE = 1e-9  # relative to the largest variance; smaller ones count as 0


class DynamicModes(Linear, Fitted):
    """Encodes the canonical directions in which the present determines the future."""

    horizon: int = Field(default=1, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        moments = Moments.none(2 * states.size + self.horizon * states.action_size)
        for shard in states.learn():
            for batch in shard.blocks(self.horizon, with_actions=True):
                assert batch.actions is not None
                rows = torch.cat([batch.now, batch.later, batch.actions], 1).double()
                moments = moments.merged(Moments.of(rows.cpu().numpy()))
        directions, correlations = canonical_directions(moments.covariance, states.size)
        directions = directions[:latents]
        present = moments.covariance[: states.size, : states.size]
        return {
            "directions": directions,
            "mean": moments.mean[: states.size],
            "back": linear_decoder(directions, present, _MIN_VARIANCE),
            "singular_values": correlations,
        }

    def encode(self, weights: Weights, scaled: Array) -> Array:
        return (scaled - weights["mean"]) @ weights["directions"].T

    def summary(self, weights: Weights) -> dict[str, Any]:
        """Returns the singular values of the dynamics in descending order."""
        return {"singular_values": [round(float(s), 4) for s in weights["singular_values"]]}


def canonical_directions(covariance: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Returns the canonical directions of the present (size, size) and their correlations (size,).

    Args:
        covariance: of rows (present, future, actions), the first two of `size` numbers.
        size: of a state.
    """
    given = covariance[2 * size :, 2 * size :]
    pair = covariance[: 2 * size, : 2 * size]
    with_actions = covariance[: 2 * size, 2 * size :]
    # Covariance of present and future given the actions.
    pair = pair - with_actions @ np.linalg.pinv(given, hermitian=True) @ with_actions.T
    white, later_white = _whitening(pair[:size, :size]), _whitening(pair[size:, size:])
    across = later_white @ pair[size:, :size] @ white.T
    _, correlations, rows = np.linalg.svd(across)
    return with_positive_largest(rows @ white), np.clip(correlations, 0, 1)


def _whitening(covariance: FloatArray) -> FloatArray:
    """Returns a matrix that whitens rows of this covariance; 0 in directions without variance."""
    # Scaled to unit variance first, so that the threshold does not depend on the features' units.
    sd = np.sqrt(np.diag(covariance))
    inverse_sd = np.divide(1, sd, out=np.zeros_like(sd), where=sd > 0)
    values, vectors = np.linalg.eigh(covariance * np.outer(inverse_sd, inverse_sd))
    is_positive = values > _MIN_VARIANCE * values[-1]
    roots = np.divide(
        1, np.sqrt(np.where(is_positive, values, 1)), out=np.zeros_like(values), where=is_positive
    )
    whitening: FloatArray = (vectors * roots) @ vectors.T * inverse_sd
    return whitening
