"""What the seeds of a cell say: estimates with intervals, in the manner of Agarwal et al. (2021).

Seeds are the only unit of replication: whatever happens within a run is averaged within it first.
Tasks are strata: a resample draws seeds with replacement within each task, never across tasks.

Every statistic takes a list of strata, each (..., seeds) with the same leading axes, and returns
(...): with none it gives the estimate, with one of resamples the bootstrap's distribution.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.report.data.curves import FloatArray

Strata = Sequence[FloatArray]
"""One array for each task: its seeds' scores, (..., seeds)."""

Statistic = Callable[..., FloatArray]
"""Takes as many `Strata` as there are groups to compare; returns (...)."""

RESAMPLES = 10_000
CONFIDENCE = 0.95
LEAST_SEEDS = 3
"""Seeds of every stratum from which an interval is given."""
DECIDING_SEEDS = 6
"""Seeds from which an interval decides: of fewer, even the lowest and the highest do not hold the
median with 95% (1 - 2^(1 - n): 75% of three seeds, 94% of five, 97% of six)."""

_NUMBERS_AT_A_TIME = 1 << 21  # of resampled scores: what stays in a processor's cache, about

# Quantiles of the normal distribution: of a two-sided test at 5%, and of a power of 80%.
_SIGNIFICANCE, _POWER = 1.959964, 0.841621
_MOST_SEEDS = 1_000_000  # that anyone could be told to train


class Estimate(NamedTuple):
    """A number with its uncertainty.

    Attributes:
        value: of the statistic on all seeds.
        low: lower end of the interval; NaN with fewer than `LEAST_SEEDS` seeds.
        high: upper end of the interval; NaN with fewer than `LEAST_SEEDS` seeds.
        standard_error: standard deviation of the bootstrap's distribution; NaN likewise.
    """

    value: float
    low: float
    high: float
    standard_error: float


def median(strata: Strata) -> FloatArray:
    """Returns the median over the seeds of all tasks."""
    pooled: FloatArray = np.median(_pooled(strata), axis=-1)
    return pooled


def mean(strata: Strata) -> FloatArray:
    """Returns the mean over tasks of the mean over seeds."""
    return _over_tasks(np.mean, [np.mean(seeds, axis=-1) for seeds in strata])


def median_of_means(strata: Strata) -> FloatArray:
    """Returns the median over tasks of the mean over seeds: what rliable calls the median."""
    return _over_tasks(np.median, [np.mean(seeds, axis=-1) for seeds in strata])


def interquartile_mean(strata: Strata) -> FloatArray:
    """Returns the mean of what is left when the lowest and highest quarter are left out.

    Of n scores, n // 4 are left out at each end (Agarwal et al., 2021, section 4.3).
    """
    ordered = np.sort(_pooled(strata), axis=-1)
    count = ordered.shape[-1]
    middle: FloatArray = np.mean(ordered[..., count // 4 : count - count // 4], axis=-1)
    return middle


def interquartile_range(strata: Strata) -> FloatArray:
    """Returns the distance between the 25th and 75th percentile of the seeds of all tasks."""
    return _range(strata, 25, 75)


def ten_to_ninety(strata: Strata) -> FloatArray:
    """Returns the distance between the 10th and 90th percentile of the seeds of all tasks."""
    return _range(strata, 10, 90)


def standard_deviation(strata: Strata) -> FloatArray:
    """Returns the standard deviation (of n - 1) over the seeds of all tasks; NaN for one seed."""
    scores = _pooled(strata)
    if scores.shape[-1] < 2:
        return np.full(scores.shape[:-1], np.nan)
    spread: FloatArray = np.std(scores, axis=-1, ddof=1)
    return spread


def probability_of_improvement(ours: Strata, theirs: Strata) -> FloatArray:
    """Returns how probable it is that a run of ours beats one of theirs, averaged over tasks.

    Ties count half: the Mann-Whitney U statistic as a share of all pairs (Agarwal et al., 2021,
    section 4.3), from the sum of ranks, since the pairs of hundreds of seeds are many.
    """
    shares = []
    for x, y in zip(ours, theirs, strict=True):
        n, m = x.shape[-1], y.shape[-1]
        ranks = _sum_of_ranks(np.concatenate([x, y], axis=-1), n)
        shares.append((ranks - n * (n + 1) / 2) / (n * m))
    return _over_tasks(np.mean, shares)


def difference(statistic: Statistic) -> Statistic:
    """Returns the statistic of ours less that of theirs."""
    return lambda ours, theirs: statistic(ours) - statistic(theirs)


def ratio(statistic: Statistic) -> Statistic:
    """Returns the statistic of ours as a multiple of that of theirs; NaN where both are 0."""

    def divided(ours: Strata, theirs: Strata) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return statistic(ours) / statistic(theirs)

    return divided


def performance_profile(strata: Strata, thresholds: FloatArray) -> FloatArray:
    """Returns the share of runs with a score above each threshold, (..., thresholds).

    Every task counts the same, however many seeds it has (Agarwal et al., 2021, section 4.2).
    """
    shares = [np.mean(seeds[..., None, :] > thresholds[:, None], axis=-1) for seeds in strata]
    return _over_tasks(np.mean, shares)


def bootstrap(
    statistics: Sequence[Statistic], *groups: Strata, resamples: int = RESAMPLES, seed: int = 0
) -> list[FloatArray]:
    """Returns each statistic of the same resampled groups, (resamples, ...).

    Args:
        statistics: of as many groups.
        groups: to compare, each resampled on its own within each of its strata.
        resamples: how many.
        seed: of the resampling; the same seed gives the same numbers.
    """
    random = np.random.default_rng(np.random.SeedSequence(seed))
    width = sum(len(seeds) for strata in groups for seeds in strata)
    at_a_time = max(1, _NUMBERS_AT_A_TIME // width)
    parts = []
    for first in range(0, resamples, at_a_time):
        count = min(at_a_time, resamples - first)
        drawn = [[_resampled(seeds, count, random) for seeds in strata] for strata in groups]
        parts.append([statistic(*drawn) for statistic in statistics])
    return [np.concatenate(one) for one in zip(*parts, strict=True)]


def estimate(
    statistic: Statistic,
    *groups: Strata,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> Estimate:
    """Returns a statistic with its interval: percentiles of the stratified bootstrap.

    Args:
        statistic: of as many groups, each a number for a group's scores (seeds,) by task.
        groups: to compare.
        resamples: of the bootstrap.
        confidence: that the interval shall have.
        seed: of the resampling.
    """
    (found,) = estimates(
        [statistic], *groups, resamples=resamples, confidence=confidence, seed=seed
    )
    return found


def estimates(
    statistics: Sequence[Statistic],
    *groups: Strata,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> list[Estimate]:
    """Returns several statistics with their intervals, all from the same resamples; `estimate`."""
    if min(seeds.shape[-1] for strata in groups for seeds in strata) == 0:
        return [Estimate(np.nan, np.nan, np.nan, np.nan)] * len(statistics)
    values = [float(statistic(*groups)) for statistic in statistics]
    if min(seeds.shape[-1] for strata in groups for seeds in strata) < LEAST_SEEDS:
        return [Estimate(value, np.nan, np.nan, np.nan) for value in values]
    drawn = bootstrap(statistics, *groups, resamples=resamples, seed=seed)
    return [_with_interval(*pair, confidence) for pair in zip(values, drawn, strict=True)]


def _with_interval(value: float, drawn: FloatArray, confidence: float) -> Estimate:
    # Seeds that never reach a threshold make infinite scores, which can't be interpolated.
    drawn = drawn[~np.isnan(drawn)]
    if not len(drawn):
        return Estimate(value, np.nan, np.nan, np.nan)
    tail = (1 - confidence) / 2
    infinite = np.isinf(drawn).any()
    low, high = np.quantile(drawn, [tail, 1 - tail], method="higher" if infinite else "linear")
    return Estimate(value, float(low), float(high), np.nan if infinite else float(np.std(drawn)))


def steps_to_threshold(
    returns: FloatArray, control_steps: FloatArray, threshold: float
) -> FloatArray:
    """Returns the control steps after which each seed first reaches a return, (seeds,).

    A seed that never does is kept, as infinity: its true value is later than its end.

    Args:
        returns: (seeds, points) smoothed episode returns; NaN past a run's end.
        control_steps: (points,) or (seeds, points).
        threshold: to reach.
    """
    reached = np.nan_to_num(returns, nan=-np.inf) >= threshold
    first = np.argmax(reached, axis=1)
    steps = np.broadcast_to(control_steps, returns.shape)
    found = np.take_along_axis(steps, first[:, None], axis=1)[:, 0]
    return np.where(reached.any(axis=1), found, np.inf)


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns how many seeds would decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the effect is taken to be what
    was seen (Cohen, 1988, chapter 2, by the normal approximation).

    Args:
        distance: of the effect from the value that would decide it.
        standard_error: of the effect, at that number of seeds.
        seeds: of each group at present.

    Returns:
        Seeds for each group, or None where no number would do: no distance, nothing known, or more
        than a million.
    """
    if not (np.isfinite(distance) and np.isfinite(standard_error)) or distance == 0:
        return None
    root = abs((_SIGNIFICANCE + _POWER) * standard_error / distance)
    if root > np.sqrt(_MOST_SEEDS / seeds):
        return None
    return max(LEAST_SEEDS, int(np.ceil(seeds * root**2)))


def _over_tasks(average: Callable[..., FloatArray], values: Sequence[FloatArray]) -> FloatArray:
    return average(values, axis=0)


def _pooled(strata: Strata) -> FloatArray:
    return np.concatenate(list(strata), axis=-1)


def _range(strata: Strata, low: float, high: float) -> FloatArray:
    ends = np.percentile(_pooled(strata), (low, high), axis=-1)
    width: FloatArray = ends[1] - ends[0]
    return width


def _sum_of_ranks(values: FloatArray, first: int) -> FloatArray:
    """Returns the sum of the ranks, from 1, of the first so many values of the last axis.

    Equal values share the mean of their ranks.
    """
    order = np.argsort(values, axis=-1)
    ordered = np.take_along_axis(values, order, axis=-1)
    places = np.arange(values.shape[-1])
    new = np.ones(values.shape, bool)
    new[..., 1:] = ordered[..., 1:] != ordered[..., :-1]
    last = np.ones(values.shape, bool)
    last[..., :-1] = new[..., 1:]
    lowest = np.maximum.accumulate(np.where(new, places, 0), axis=-1)
    backwards = np.where(last, places, values.shape[-1])[..., ::-1]
    highest = np.minimum.accumulate(backwards, axis=-1)[..., ::-1]
    total: FloatArray = np.sum((1 + (lowest + highest) / 2) * (order < first), axis=-1)
    return total


def _resampled(seeds: FloatArray, resamples: int, random: np.random.Generator) -> FloatArray:
    count = len(seeds)
    chosen: NDArray[np.int64] = random.integers(count, size=(resamples, count))
    return seeds[chosen]
