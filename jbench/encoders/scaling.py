"""The scaling of an encoder's inputs, saved with the encoder."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.encoders.moments import Moments


@dataclass(frozen=True)
class Scaling:
    """Maps a range of each feature to [-1, 1].

    Attributes:
        minimum: (dim(O),) of the ranges, such as the extremes over a dataset.
        maximum: (dim(O),) of the ranges.
    """

    minimum: NDArray[np.float32]
    maximum: NDArray[np.float32]

    @classmethod
    def of(cls, observations: NDArray[np.float32]) -> "Scaling":
        """Returns the scaling of a dataset (..., dim(O))."""
        rows = observations.reshape(-1, observations.shape[-1])
        return cls(rows.min(axis=0), rows.max(axis=0))

    @classmethod
    def none(cls, size: int) -> "Scaling":
        """Returns the scaling that changes nothing."""
        return cls(np.full(size, -1, np.float32), np.full(size, 1, np.float32))

    @classmethod
    def to_unit_variance(cls, moments: Moments) -> "Scaling":
        """Returns the scaling to mean 0 and variance 1."""
        sd = np.sqrt(moments.variance)
        return cls((moments.mean - sd).astype(np.float32), (moments.mean + sd).astype(np.float32))

    def merged(self, other: "Scaling") -> "Scaling":
        """Returns the scaling of both datasets together."""
        return Scaling(
            np.minimum(self.minimum, other.minimum), np.maximum(self.maximum, other.maximum)
        )

    def gain_and_offset(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns (dim(O),) numbers such that scaled = gain * observation + offset.

        Features that are constant to the precision of float32 are mapped to 0.
        """
        low, width, varies = self._widths()
        gain = np.divide(2, width, out=np.zeros_like(width), where=varies)
        offset = np.where(varies, -1 - gain * low, 0)
        return gain.astype(np.float32), offset.astype(np.float32)

    def half_width_and_center(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns (dim(O),) numbers such that observation = half_width * scaled + center.

        The half width of a constant feature is 0.
        """
        low, width, varies = self._widths()
        return np.where(varies, width / 2, 0), low + width / 2

    def _widths(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Returns minimum and width of each feature, and whether it varies."""
        low, high = self.minimum.astype(np.float64), self.maximum.astype(np.float64)
        width = high - low
        return low, width, width > 1e-5 * np.maximum(np.abs(low), np.abs(high))
