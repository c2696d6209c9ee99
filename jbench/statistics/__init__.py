"""The statistics of jbench's comparisons: intervals, verdicts, sequential tests."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ROUNDING = 1e-9
"""Differences of means that count as equal in permutation tests, relative to the largest score."""
