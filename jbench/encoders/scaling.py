"""Moments of rows, the scaling of an encoder's inputs, and the option `rescale` of its latents.

Moments are in float64, and blocks are merged by their means (Chan, Golub and LeVeque, 1983),
which is accurate for millions of rows.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.array_types import FloatArray
from jbench.tasks.find import find_task

_SD = 1 / 3  # of whitened latents: most values are in [-1, 1], as those of scaled features
_MIN_VARIANCE = 1e-10  # relative to the largest; directions of smaller variance become 0
_CONSTANT = 1e-6  # standard deviation relative to the mean; float32 rounds to some 1e-7


class Moments(NamedTuple):
    """Moments of some rows."""

    rows: int  # number of rows
    mean: FloatArray  # (size,) of the columns
    covariance: FloatArray  # (size, size), divided by the count

    @classmethod
    def of(cls, rows: NDArray[np.floating]) -> "Moments":
        """Returns the moments of rows (..., size); all are 0 if there are none."""
        values = rows.reshape(-1, rows.shape[-1]).astype(np.float64)
        count = max(len(values), 1)
        mean = values.sum(axis=0) / count
        values -= mean
        return cls(len(values), mean, values.T @ values / count)

    def merged(self, other: "Moments") -> "Moments":
        """Returns the moments of the union of both sets of rows."""
        rows = self.rows + other.rows
        if not rows:
            return self
        fraction = other.rows / rows
        difference = other.mean - self.mean
        covariance = (1 - fraction) * self.covariance + fraction * other.covariance
        covariance += fraction * (1 - fraction) * np.outer(difference, difference)
        return Moments(rows, self.mean + fraction * difference, covariance)

    def scaled(self, gain: NDArray[np.floating], offset: NDArray[np.floating]) -> "Moments":
        """Returns the moments of gain * row + offset, both (size,)."""
        mean = gain.astype(np.float64) * self.mean + offset
        return Moments(self.rows, mean, np.outer(gain, gain).astype(np.float64) * self.covariance)

    def only(self, columns: Sequence[int]) -> "Moments":
        """Returns the moments of some of the columns."""
        chosen = list(columns)
        return Moments(self.rows, self.mean[chosen], self.covariance[np.ix_(chosen, chosen)])

    def regression(self, inputs: int) -> tuple[FloatArray, FloatArray]:
        """Returns the least squares slopes (inputs, others) and offset (others,).

        The first `inputs` columns predict the others, whatever their units. Those that are constant
        up to the rounding of float32 have the slope 0.
        """
        within = self.covariance[:inputs, :inputs]
        across = self.covariance[:inputs, inputs:]
        sd = np.sqrt(np.diag(within))
        # Of unit variance, so that none is left out because its unit is large.
        unit = inverse(np.where(sd > _CONSTANT * np.abs(self.mean[:inputs]), sd, 0))
        correlation = within * np.outer(unit, unit)
        scaled = np.linalg.pinv(correlation, rcond=1e-12, hermitian=True) @ (unit[:, None] * across)
        slopes = unit[:, None] * scaled
        return slopes, self.mean[inputs:] - self.mean[:inputs] @ slopes


def with_positive_largest(directions: FloatArray) -> FloatArray:
    """Returns rows, whose signs are arbitrary, with a positive largest component each."""
    largest = np.argmax(np.abs(directions), axis=1)
    signs = np.sign(directions[np.arange(len(directions)), largest])
    return directions * np.where(signs, signs, 1)[:, None]


class Scaling(NamedTuple):
    """Maps a range of each feature, such as its extremes over a dataset, to [-1, 1]."""

    minimum: NDArray[np.float32]  # (dim(O),) of the ranges
    maximum: NDArray[np.float32]  # (dim(O),) of the ranges

    @classmethod
    def of(cls, observations: NDArray[np.float32]) -> "Scaling":
        """Returns the scaling of a dataset (..., dim(O))."""
        rows = observations.reshape(-1, observations.shape[-1])
        return cls(rows.min(axis=0), rows.max(axis=0))

    def merged(self, other: "Scaling") -> "Scaling":
        """Returns the scaling of both datasets together."""
        return Scaling(
            minimum=np.minimum(self.minimum, other.minimum),
            maximum=np.maximum(self.maximum, other.maximum),
        )

    def only(self, columns: Sequence[int]) -> "Scaling":
        """Returns the scaling of some of the features."""
        chosen = list(columns)
        return Scaling(self.minimum[chosen], self.maximum[chosen])

    def gain_and_offset(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns (dim(O),) numbers such that scaled = gain * observation + offset.

        Features that are constant to the precision of float32 are mapped to 0.
        """
        half_width, _ = self.half_width_and_center()
        gain = inverse(half_width)
        offset = np.where(half_width > 0, -1 - gain * self.minimum.astype(np.float64), 0)
        return gain.astype(np.float32), offset.astype(np.float32)

    def half_width_and_center(self) -> tuple[FloatArray, FloatArray]:
        """Returns (dim(O),) numbers such that observation = half_width * scaled + center.

        The half width of a constant feature is 0.
        """
        low = self.minimum.astype(np.float64)
        high = self.maximum.astype(np.float64)
        width = high - low
        varies = width > 1e-5 * np.maximum(np.abs(low), np.abs(high))
        return np.where(varies, width / 2, 0), low + width / 2


def physical_scaling(task: str, scaling: Scaling) -> tuple[FloatArray, FloatArray]:
    """Returns (dim(O),) gain and offset: features in SI units = gain * scaled + offset."""
    gain, offset = scaling.half_width_and_center()
    physical = find_task(task).physical
    center = np.asarray(physical(offset), np.float64)
    return physical(offset + gain) - center, center


def inverse(values: FloatArray) -> FloatArray:
    """Returns 1 / value of each, or 0 where it is not positive, as the width of a constant."""
    return np.divide(1, values, out=np.zeros_like(values), where=values > 0)


def rescaling(option: str, blocks: Iterable[NDArray[np.float32]]) -> dict[str, FloatArray]:
    """Returns the weights of the option `rescale` for latents, given in blocks (rows, latents).

    "whitened" scales every principal direction to a standard deviation of 1/3, "standardized" every
    latent to one of 1, and "extremes" maps the extremes of every latent to -1 and 1.
    """
    if option == "extremes":
        half_width, center = reduce(Scaling.merged, map(Scaling.of, blocks)).half_width_and_center()
        return _rescaling(center, np.diag(inverse(half_width)), np.diag(half_width))

    moments = reduce(Moments.merged, map(Moments.of, blocks))
    if option == "standardized":
        variance = np.diag(moments.covariance)
        sd = np.sqrt(np.where(variance > _MIN_VARIANCE * variance.max(), variance, 0))
        return _rescaling(moments.mean, np.diag(inverse(sd)), np.diag(sd))

    ascending, vectors = np.linalg.eigh(moments.covariance)
    variance = ascending[::-1]
    directions = with_positive_largest(vectors[:, ::-1].T)
    varies = variance > _MIN_VARIANCE * variance[0]
    gain = np.where(varies, _SD / np.sqrt(np.where(varies, variance, 1)), 0)
    return _rescaling(moments.mean, directions * gain[:, None], directions.T * inverse(gain))


def _rescaling(center: FloatArray, matrix: FloatArray, back: FloatArray) -> dict[str, FloatArray]:
    """Returns weights of the map of latents to matrix @ (latents - center), and of its inverse."""
    return {"rescale.center": center, "rescale.matrix": matrix, "rescale.inverse": back}
