"""The option `rescale` of all kinds: an affine map of the latents, computed after the training.

`whitened` removes the mean and scales every principal direction of the latents over the training
states to a standard deviation of 1/3, so that most values are in [-1, 1] like those of scaled
features. `extremes` maps every latent from its extremes to [-1, 1].
"""

from collections.abc import Callable, Iterable, Mapping
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.moments import Moments
from jbench.encoders.scaling import Scaling
from jbench.tasks.features import Array

_CENTER, _MATRIX, _INVERSE = "rescale.center", "rescale.matrix", "rescale.inverse"

_SD = 1 / 3
_MIN_VARIANCE = 1e-10  # relative to the largest; directions of smaller variance become 0


def apply(weights: Mapping[str, Any], latents: Array) -> Array:
    """Returns rescaled latents (..., latents)."""
    return (latents - weights[_CENTER]) @ weights[_MATRIX].T


def invert(weights: Mapping[str, Any], latents: Array) -> Array:
    """Returns the latents (..., latents) before rescaling."""
    return latents @ weights[_INVERSE].T + weights[_CENTER]


def whitening(blocks: Iterable[NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
    """Returns the weights that whiten latents, given in blocks (rows, latents)."""
    moments = reduce(Moments.merged, map(Moments.of, blocks))
    variance, vectors = np.linalg.eigh(moments.covariance)
    variance, vectors = variance[::-1], vectors[:, ::-1]
    # An eigenvector's sign is arbitrary: its largest component is made positive.
    largest = np.argmax(np.abs(vectors), axis=0)
    vectors = vectors * np.sign(vectors[largest, np.arange(len(variance))])
    varies = variance > _MIN_VARIANCE * variance[0]
    sd = np.sqrt(np.where(varies, variance, 1))
    return _weights(moments.mean, (vectors * (varies * _SD / sd)).T, vectors * (varies * sd / _SD))


def to_extremes(blocks: Iterable[NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
    """Returns the weights that map the extremes of latents, in blocks (rows, latents), to +-1."""
    extremes = reduce(Scaling.merged, map(Scaling.of, blocks))
    half_width, center = extremes.half_width_and_center()
    gain = np.divide(1, half_width, out=np.zeros_like(half_width), where=half_width > 0)
    return _weights(center, np.diag(gain), np.diag(half_width))


RESCALINGS: dict[str, Callable[[Iterable[NDArray[np.float32]]], dict[str, NDArray[np.float32]]]] = {
    "whitened": whitening,
    "extremes": to_extremes,
}
"""Functions that compute the weights from the latents of the training states, by option."""


def _weights(
    center: NDArray[np.float64], matrix: NDArray[np.float64], inverse: NDArray[np.float64]
) -> dict[str, NDArray[np.float32]]:
    named = {_CENTER: center, _MATRIX: matrix, _INVERSE: inverse}
    return {name: np.ascontiguousarray(value, np.float32) for name, value in named.items()}
