"""Random numbers of the bootstrap: which seeds are in each resample."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from jbench.report.data.curves import FloatArray, IntArray

Sizes = tuple[tuple[int, ...], ...]
"""Numbers of seeds of the strata of each group."""

_NUMBERS_AT_A_TIME = 1 << 21  # about the resampled scores that fit into a processor's cache


@dataclass(eq=False)
class Draws:
    """Resampled seeds of each stratum of each group.

    Attributes:
        chosen: (resamples, seeds) indices of the seeds, for each stratum of each group.
    """

    chosen: list[list[IntArray]]

    @cached_property
    def counts(self) -> list[list[FloatArray]]:
        """How often each seed occurs in each resample, (resamples, seeds), as `chosen`."""
        return [[_counts(index) for index in strata] for strata in self.chosen]


def _counts(index: IntArray) -> FloatArray:
    """Returns how often each seed occurs in each resample, (resamples, seeds)."""
    rows = np.arange(len(index))[:, None] * index.shape[1]
    counts = np.bincount((rows + index).ravel(), minlength=index.size)
    return counts.reshape(index.shape).astype(np.float64)


def draws(sizes: Sizes, resamples: int) -> Iterable[Draws]:
    """Returns the resampled seeds in parts; groups of the same sizes share them, if few."""
    few = resamples * sum(map(sum, sizes)) <= _NUMBERS_AT_A_TIME
    return (_drawn_once if few else _drawn)(sizes, resamples)


# Statistics of cells and of pairs of cells have different sizes.
@lru_cache(maxsize=2)
def _drawn_once(sizes: Sizes, resamples: int) -> list[Draws]:
    return list(_drawn(sizes, resamples))


def _drawn(sizes: Sizes, resamples: int) -> Iterator[Draws]:
    random = np.random.default_rng(np.random.SeedSequence(0))
    at_a_time = max(1, _NUMBERS_AT_A_TIME // sum(map(sum, sizes)))
    for first in range(0, resamples, at_a_time):
        count = min(at_a_time, resamples - first)
        yield Draws(
            [[random.integers(seeds, size=(count, seeds)) for seeds in strata] for strata in sizes]
        )
