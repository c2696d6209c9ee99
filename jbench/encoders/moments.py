"""Streaming count, mean and covariance of rows.

Everything is in float64, and blocks are merged by their means (Chan, Golub and LeVeque, 1983),
which is accurate for millions of rows.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Moments(NamedTuple):
    """Moments of some rows."""

    rows: int  # number of rows
    mean: FloatArray  # (size,) of the columns
    covariance: FloatArray  # (size, size), divided by the count

    @classmethod
    def none(cls, size: int) -> "Moments":
        """Returns the moments of no rows."""
        return cls(0, np.zeros(size), np.zeros((size, size)))

    @classmethod
    def of(cls, rows: NDArray[np.floating]) -> "Moments":
        """Returns the moments of rows (..., size)."""
        size = rows.shape[-1]
        values = rows.reshape(-1, size).astype(np.float64)
        if not len(values):
            return cls.none(size)
        mean = values.mean(axis=0)
        values -= mean
        return cls(len(values), mean, values.T @ values / len(values))

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

    def regression(self, inputs: int) -> tuple[FloatArray, FloatArray]:
        """Returns the least squares slopes (inputs, others) and offset (others,).

        The first `inputs` columns predict the others.
        """
        within, across = self.covariance[:inputs, :inputs], self.covariance[:inputs, inputs:]
        slopes = np.linalg.pinv(within, rcond=1e-12, hermitian=True) @ across
        return slopes, self.mean[inputs:] - self.mean[:inputs] @ slopes

    @property
    def variance(self) -> FloatArray:
        """(size,) variance of each column."""
        return np.diag(self.covariance).copy()


def with_positive_largest(directions: FloatArray) -> FloatArray:
    """Returns rows, whose signs are arbitrary, with a positive largest component each."""
    largest = np.argmax(np.abs(directions), axis=1)
    signs = np.sign(directions[np.arange(len(directions)), largest])
    return directions * np.where(signs, signs, 1)[:, None]
