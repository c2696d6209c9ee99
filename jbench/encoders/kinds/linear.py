"""Linear kinds without a training loop: the controls that any learned encoder must beat."""

from collections.abc import Iterator
from functools import reduce
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from jbench.array_types import FloatArray
from jbench.arrays import Array
from jbench.encoders import scaling
from jbench.encoders.kind import Fitted, Kind
from jbench.encoders.networks import Weights, tanh
from jbench.encoders.pairs import MAX_PAIRS, state_pairs
from jbench.encoders.scaling import Moments, inverse
from jbench.encoders.states import MAX_HORIZON, States
from jbench.tasks.find import find_task

_MIN_DYNAMIC_VARIANCE = 1e-9  # relative to the largest variance; smaller ones count as 0


class Projection(Kind):
    """Projects the centered state on some of its weights, and decodes by others.

    Attributes:
        encoding: name of the weights (latents, size) that encode.
        decoding: name of the weights (latents, size) that decode.
    """

    encoding: ClassVar[str] = "directions"
    decoding: ClassVar[str] = "back"

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Projects the deviation from the mean."""
        return (scaled - weights["mean"]) @ weights[self.encoding].T

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Adds the mean again."""
        return latents @ weights[self.decoding] + weights["mean"]


class PrincipalComponents(Projection, Fitted):
    """Projects on the directions of the largest variance (Pearson, 1901; Hotelling, 1933).

    It is the best linear encoder and decoder.
    """

    encoding = "components"
    decoding = "components"

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """The eigenvectors of the largest variances, with positive largest entries."""
        _, vectors = np.linalg.eigh(states.learned.covariance)
        components = scaling.with_positive_largest(vectors[:, ::-1][:, :latents].T)
        return {"components": components, "mean": states.learned.mean}


class RandomProjection(Projection, Fitted):
    """Projects on random orthogonal directions (Johnson and Lindenstrauss, 1984).

    They do not depend on the data: they are rows of a uniformly distributed random orthogonal
    matrix (Mezzadri, 2007). Least squares give a linear decoder, so that a reconstruction error can
    be reported.
    """

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """Random orthogonal rows, and the linear decoder with the least error."""
        moments = states.learned
        size = states.size
        random = np.random.default_rng(np.random.SeedSequence(states.seed))
        rotation, triangle = np.linalg.qr(random.normal(size=(size, size)))
        # The first rows of one matrix, so that larger projections contain smaller ones.
        projection = (rotation * np.sign(np.diag(triangle))).T[:latents]
        # Constant features can leave directions without variance.
        decoder = linear_decoder(projection, moments.covariance, 1e-12)
        mean = moments.mean - moments.mean @ projection.T @ decoder
        return {"projection": projection, "back": decoder, "mean": mean}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Projects without a mean, which the decoder adds."""
        return scaled @ weights["projection"].T


class RandomFeatures(Projection, Fitted):
    """Tanh of random directions with random offsets (Rahimi and Recht, 2007).

    Their number may exceed the size of the observation: they are the control for learned
    representations that are larger, and show the effect of the number of inputs alone. The argument
    of the tanh has unit variance on average over the directions, and an offset between -1 and 1.
    """

    def latent_sizes(self, task: str, features: int) -> range:
        """Any size, since features are drawn at random."""
        return range(1, 4097)

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """Random directions and offsets, and a linear regression as decoder.

        The regression is on the first shard: a part of a dataset that does not fit in memory.
        """
        random = np.random.default_rng(np.random.SeedSequence(states.seed))
        sd = np.sqrt(np.trace(states.learned.covariance))
        directions = random.normal(size=(latents, states.size)) / sd
        offsets = random.uniform(-1, 1, latents) - directions @ states.learned.mean
        weights = {"directions": directions, "offsets": offsets}
        blocks = _blocks(next(states.learn()).states)
        pairs = (np.hstack([self.encode(weights, rows), rows]) for rows in blocks)
        decoder, mean = reduce(Moments.merged, map(Moments.of, pairs)).regression(latents)
        return weights | {"back": decoder, "mean": mean}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Applies tanh to random projections."""
        return tanh(scaled @ weights["directions"].T + weights["offsets"])


class Scaled(Fitted):
    """Returns the scaled features: the control for the scaling of the other kinds.

    Encoders scale each feature to [-1, 1] before they reduce them, so an agent on latents and an
    agent on observations also differ in the scale of their inputs.
    """

    is_rowwise = True

    def latent_sizes(self, task: str, features: int) -> range:
        """As many as there are features."""
        return range(features, features + 1)

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """There is nothing to learn."""
        return {}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the features as agents scale them."""
        return scaled

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the latents, which are the features."""
        return latents


class Raw(Fitted):
    """Returns the observation in SI units, without any scaling.

    It is the control for the nominal scaling of the tasks' observations, which the authors'
    environment did not have before September 2019. The motor speed then varies by 180 and the
    quaternion by 1.
    """

    is_rowwise = True

    def latent_sizes(self, task: str, features: int) -> range:
        """As many as there are features, if their units are known."""
        # The units of other robots' observations are not known.
        if find_task(task).units is None:
            return range(0)
        return range(features, features + 1)

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """The scaling to SI units and its inverse."""
        gain, offset = states.physical_scaling()
        return {"gain": gain, "offset": offset, "inverse": inverse(gain)}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the features in SI units."""
        return scaled * weights["gain"] + weights["offset"]

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Scales the features again."""
        return (latents - weights["offset"]) * weights["inverse"]


class DynamicModes(Projection, Fitted):
    """Dynamic mode decomposition with control, independent of the units of the features.

    A linear model x' = A x + B u + noise of the scaled states x and the actions u is fitted by
    least squares (Proctor, Brunton and Kutz, arXiv:1409.6358). Plain decomposition truncates A to
    the directions of the largest variance, which depend on the features' units. Here x and x' are
    whitened first. The singular values of A are then the canonical correlations of present and
    future given the actions (Hotelling, 1936): numbers from 0 to 1 that no invertible linear change
    of the features alters. The number of large ones is the order of the linear dynamics. The
    latents are the first canonical directions of the present, of unit variance. Among all linear
    encoders of that size they give the best linear prediction of the whitened future.
    """

    horizon: int = Field(
        default=1, ge=1, lt=MAX_HORIZON, description="control steps ahead of the future; ours"
    )

    def fit(self, states: States, latents: int) -> dict[str, FloatArray]:
        """The directions of the present that best predict the future beside the actions."""
        size = states.size
        batches = state_pairs(states.learn(), self.horizon, with_actions=True)
        rows = (torch.cat([b.now, b.later, b.actions], 1).double() for b in batches)
        moments = reduce(Moments.merged, (Moments.of(some.cpu().numpy()) for some in rows))
        actions = moments.covariance[2 * size :, 2 * size :]
        pair, across = np.split(moments.covariance[: 2 * size], [2 * size], axis=1)
        # Covariance of present and future given the actions.
        partial = pair - across @ np.linalg.pinv(actions, hermitian=True) @ across.T
        white = _whitening(partial[:size, :size])
        later_white = _whitening(partial[size:, size:])
        _, correlations, rotation = np.linalg.svd(later_white @ partial[size:, :size] @ white.T)
        directions = scaling.with_positive_largest(rotation @ white)[:latents]

        return {
            "directions": directions,
            "mean": moments.mean[:size],
            "back": linear_decoder(directions, pair[:size, :size], _MIN_DYNAMIC_VARIANCE),
            "singular_values": np.clip(correlations, 0, 1),
        }

    def summary(self, weights: Weights) -> dict[str, Any]:
        """Returns the singular values of the dynamics in descending order."""
        return {"singular_values": [round(float(s), 4) for s in weights["singular_values"]]}


def _blocks(episodes: Tensor) -> Iterator[NDArray[np.float32]]:
    """Yields the states of episodes (episodes, states, size), a few of a long one at a time.

    Episodes that end early are one after another in a row, as long as the dataset: all of its
    latents at once may not fit in memory.
    """
    for episode in episodes.cpu():
        for block in episode.split(MAX_PAIRS):
            yield block.numpy()


def linear_decoder(
    directions: FloatArray, covariance: FloatArray, min_variance: float
) -> FloatArray:
    """Returns the (latents, size) matrix that best reconstructs rows from directions @ row.

    Variances smaller than `min_variance`, relative to the largest, count as 0.
    """
    across = directions @ covariance
    within = np.linalg.pinv(across @ directions.T, rcond=min_variance, hermitian=True)
    decoder: FloatArray = within @ across
    return decoder


def _whitening(covariance: FloatArray) -> FloatArray:
    """Returns a matrix that whitens rows of this covariance; 0 in directions without variance."""
    # Scaled to unit variance first, so that the threshold does not depend on the features' units.
    inverse_sd = inverse(np.sqrt(np.diag(covariance)))
    values, vectors = np.linalg.eigh(covariance * np.outer(inverse_sd, inverse_sd))
    is_positive = values > _MIN_DYNAMIC_VARIANCE * values[-1]
    roots = inverse(np.sqrt(np.where(is_positive, values, 0)))
    whitening: FloatArray = (vectors * roots) @ vectors.T * inverse_sd
    return whitening
