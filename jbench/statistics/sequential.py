"""A group-sequential test, which compares two configurations while seeds are still being added.

Seeds come in blocks of five, and an interim analysis follows each block; the comparison
stops as soon as it is decided. The test is a permutation test whose labels are exchanged within
blocks, as in AdaStop (Mathieu et al., *AdaStop: adaptive statistical testing for sound comparisons
of Deep RL agents*, TMLR 2024, section 4), so that it is valid for five seeds and for any
distribution. The share of the error rate spent up to each analysis grows in proportion to the seeds
(Lan and DeMets, *Discrete sequential boundaries for clinical trials*, Biometrika 70, 1983; Kim and
DeMets, *Design and analysis of group sequential tests based on the type I error spending rate
function*, Biometrika 74, 1987). The tests of all shifts together give repeated confidence intervals
(Jennison and Turnbull, *Interim analyses: the repeated confidence interval approach*, J. R.
Statist. Soc. B 51, 1989), on which decisions are based.

If the distributions of two configurations differ only in a shift, the intervals of all analyses
contain that shift with probability 1 - error rate. For distributions that differ in more than a
shift this holds approximately, since both have equally many seeds in each block; but not if seeds
of only one side fail, and rarely (docs/deciding.md). `step_down` divides the error rate of several
comparisons.
"""

import itertools
from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

from jbench.array_types import BoolArray, FloatArray, IntArray
from jbench.statistics import ROUNDING
from jbench.statistics.verdicts import Verdict

BLOCK = 5
"""Seeds of each configuration between two interim analyses."""

RELABELINGS_OF_TWO_BLOCKS = 63_504
"""Relabelings of a test: all of two blocks of 5 + 5 seeds; with more blocks, a random sample."""

_BISECTIONS = 16  # precision of an interval's end: 1e-4 of the range of the seeds


def decided_at(
    verdict: Verdict,
    ours: FloatArray,
    theirs: FloatArray,
    margin: float,
    error_rate: float,
    analyses: int,
    *,
    relabelings: int = RELABELINGS_OF_TWO_BLOCKS,
) -> IntArray:
    """Returns the interim analysis (...), from 1 on, that reaches a verdict; 0 if none does.

    Args:
        ours, theirs: (..., seeds) numbers of the seeds in complete blocks.
        margin: two configurations that differ by less are equal; 0 if none are.
        error_rate: two-sided, over all analyses.
        analyses: number of planned analyses.
    """
    above = partial(
        first_above, error_rate=error_rate / 2, analyses=analyses, relabelings=relabelings
    )
    if verdict == "equal":
        if not margin:
            return np.zeros(ours.shape[:-1], np.int64)
        lower, upper = above(ours + margin, theirs), above(theirs + margin, ours)
        return np.where((lower > 0) & (upper > 0), np.maximum(lower, upper), 0)
    return above(ours, theirs) if verdict == "larger" else above(theirs, ours)


def first_above(
    ours: FloatArray,
    theirs: FloatArray,
    error_rate: float,
    analyses: int,
    *,
    block: int = BLOCK,
    relabelings: int = RELABELINGS_OF_TWO_BLOCKS,
) -> IntArray:
    """Returns the analysis (...) that finds ours to be above theirs, one-sided; 0 if none does.

    The statistic is the difference of the means. If both have the same distribution, the
    labels within a block are exchangeable. An analysis rejects if the observed labels are among the
    relabelings with the largest differences. Their number is what the error rate spent so far
    allows, minus those that earlier ones reject. Ties at the boundary do not reject.

    Args:
        ours, theirs: (..., seeds) numbers of the seeds in complete blocks.
        error_rate: one-sided, over all analyses.
        analyses: number of planned analyses; the seeds may cover fewer.
        relabelings: maximum number of relabelings, sampled if there are more.
    """
    shape = (*ours.shape[:-1], -1, block)
    # Sorted, because sampled relabelings must not depend on the order of the seeds in a block.
    sides = [np.sort(side.reshape(shape), axis=-1) for side in (ours, theirs)]
    pooled = np.concatenate(sides, axis=-1)
    # (..., blocks, relabelings of a block): the block's difference under each of them.
    differences = pooled @ _weights(block).T
    rounding = ROUNDING * np.abs(pooled).max(axis=(-1, -2))[..., None]
    first = np.zeros(ours.shape[:-1], np.int64)
    boundaries: list[FloatArray] = []
    for chosen in _tables(differences.shape[-1], differences.shape[-2], relabelings):
        sums = np.zeros((*first.shape, chosen.shape[1]))
        crossed = np.zeros(sums.shape, bool)
        for j, relabeling in enumerate(chosen):
            sums += differences[..., j, :][..., relabeling]
            if j == len(boundaries):
                allowed = int(error_rate * (j + 1) / analyses * sums.shape[-1])
                boundaries.append(_boundary(sums, crossed, allowed) + rounding)
                first[(first == 0) & (sums[..., 0] > boundaries[j][..., 0])] = j + 1

            crossed |= sums > boundaries[j]

    return first


def _boundary(sums: FloatArray, crossed: BoolArray, allowed: int) -> FloatArray:
    """Returns the value (..., 1) that at most `allowed` relabelings exceed or have exceeded."""
    kept = np.where(crossed, -np.inf, sums)
    places = sums.shape[-1] - 1 - np.maximum(allowed - crossed.sum(axis=-1, keepdims=True), 0)
    ordered = np.partition(kept, np.unique(places), axis=-1)
    return np.take_along_axis(ordered, places, axis=-1)


def interval(
    ours: FloatArray, theirs: FloatArray, error_rate: float, analyses: int, margin: float = 0.0
) -> tuple[float, float]:
    """Returns the repeated confidence interval of ours minus theirs at the last analysis.

    It contains the shifts that no analysis up to this one rejects; see `decided_at` for arguments.
    So it contains 0 if, and only if, neither side is found to be larger, and lies within the margin
    if, and only if, both are found to be equal.
    """
    low = _lower_end(ours, theirs, error_rate / 2, analyses, margin)
    high = -_lower_end(theirs, ours, error_rate / 2, analyses, margin)
    return low, high


def _lower_end(
    ours: FloatArray, theirs: FloatArray, error_rate: float, analyses: int, margin: float
) -> float:
    """Returns the lower end of the interval: the one-sided test rejects the shifts below it.

    The test subtracts a shift from ours, and rejects the shift if ours are still above theirs. The
    end is between a rejected shift and one that is not, which bisection brings together. A verdict
    depends on which side of 0 and of the margins the end is, so these limits are tested, too.
    """

    def rejects(shift: float) -> bool:
        return bool(first_above(ours - shift, theirs, error_rate, analyses))

    difference = float(ours.mean() - theirs.mean())
    deviations = np.concatenate([ours - difference, theirs])
    largest = float(np.abs(np.concatenate([ours, theirs])).max())
    # Of seeds that are all alike, the difference at the least shift must be more than rounding.
    rounding = 10 * ROUNDING * largest
    least = difference - max(4 * float(np.ptp(deviations)) + 1e-9, rounding)
    if not rejects(least):
        return -np.inf

    rejected, kept = _halved(rejects, least, difference)
    for limit in sorted({-margin, 0.0, margin}):
        if not rejected < limit < kept + rounding:
            continue

        if not rejects(limit):
            rejected, _ = _halved(rejects, rejected, limit)
            # Nearer than rounding, the end is the limit itself.
            return limit if limit < rejected + rounding else rejected

        rejected, kept = _halved(rejects, limit, kept)
        if rejected == limit:  # which has to be outside of the interval
            return kept

    return rejected


def _halved(rejects: Callable[[float], bool], rejected: float, kept: float) -> tuple[float, float]:
    """Returns a rejected shift and a larger one that is not, closer together by bisection."""
    for _ in range(_BISECTIONS):
        shift = (rejected + kept) / 2
        if rejects(shift):
            rejected = shift
        else:
            kept = shift

    return rejected, kept


@lru_cache
def _weights(block: int) -> FloatArray:
    """Returns weights (relabelings, 2 block) of a block's seeds in its difference of means.

    The first row is that of the observed labels.
    """
    ours = list(itertools.combinations(range(2 * block), block))
    weights = np.full((len(ours), 2 * block), -1 / block)
    np.put_along_axis(weights, np.array(ours), 1 / block, axis=1)
    return weights


@lru_cache
def _tables(count: int, blocks: int, max_size: int) -> list[IntArray]:
    """Returns tables (blocks, relabelings) with the index of each block's relabeling.

    There is a table of all relabelings for one block, for two, and so on, while their number is at
    most `max_size`; then one random sample for all blocks. A later analysis repeats the
    earlier ones in its own table. The first relabeling is always that of the observed labels,
    without which a sampled permutation test would reject too often.
    """
    tables = []
    for complete in range(1, blocks + 1):
        if count**complete > max_size:
            drawn = [np.random.default_rng(j).integers(count, size=max_size) for j in range(blocks)]
            tables.append(np.stack(drawn))
            tables[-1][:, 0] = 0
            break

        tables.append(np.indices((count,) * complete).reshape(complete, -1))

    return tables
