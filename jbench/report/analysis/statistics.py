"""Estimates with bootstrap intervals, following Agarwal et al. (2021).

Seeds are the only unit of replication: values within a run are averaged first. Tasks are strata: a
resample draws seeds with replacement within each task, never across tasks.

Every statistic takes a list of strata, each (..., seeds) with the same leading axes, and returns
(...). Without leading axes it returns the estimate; with an axis of resamples, the bootstrap
distribution.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.report.data.curves import FloatArray

Strata = Sequence[FloatArray]
"""One array of scores (..., seeds) per task."""

Statistic = Callable[..., FloatArray]
"""Takes as many `Strata` as there are groups to compare; returns (...)."""

RESAMPLES = 10_000
CONFIDENCE = 0.95
MIN_SEEDS = 3
"""Minimum number of seeds per stratum for an interval."""
DECIDING_SEEDS = 6
"""Minimum number of seeds for a verdict. With fewer, not even the range of all seeds contains the
population median with 95% (1 - 2^(1 - n): 75% for three seeds, 94% for five, 97% for six)."""

_NUMBERS_AT_A_TIME = 1 << 21  # resampled scores that fit into a processor's cache, about

# Quantiles of the normal distribution, for a two-sided test at 5% and for a power of 80%.
_SIGNIFICANCE, _POWER = 1.959964, 0.841621
_MAX_SEEDS = 1_000_000  # limit of a recommendation


class Estimate(NamedTuple):
    """A number with its uncertainty, which is NaN with fewer than `MIN_SEEDS` seeds.

    Attributes:
        value: the statistic of all seeds.
        low: lower end of the interval.
        high: upper end of the interval.
        standard_error: standard deviation of the bootstrap distribution.
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
    """Returns the median over tasks of the mean over seeds, which rliable calls the median."""
    return _over_tasks(np.median, [np.mean(seeds, axis=-1) for seeds in strata])


def interquartile_mean(strata: Strata) -> FloatArray:
    """Returns the mean without the lowest and highest quarter.

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
    """Returns the probability that a run of ours beats one of theirs, averaged over tasks.

    Ties count half. It is the Mann-Whitney U statistic as a share of all pairs (Agarwal et al.,
    2021, section 4.3), computed from the sum of ranks, which is faster than all pairs.
    """
    shares = []
    for x, y in zip(ours, theirs, strict=True):
        n, m = x.shape[-1], y.shape[-1]
        ranks = _sum_of_ranks(np.concatenate([x, y], axis=-1), n)
        shares.append((ranks - n * (n + 1) / 2) / (n * m))
    return _over_tasks(np.mean, shares)


def difference(statistic: Statistic) -> Statistic:
    """Returns the difference of a statistic, ours minus theirs."""
    return lambda ours, theirs: statistic(ours) - statistic(theirs)


def ratio(statistic: Statistic) -> Statistic:
    """Returns the ratio of a statistic, ours to theirs; NaN if both are 0."""

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
        statistics: statistics that take as many groups.
        groups: groups to compare, each resampled independently within each of its strata.
        resamples: number of resamples.
        seed: random seed.
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
        statistic: statistic that takes as many groups.
        groups: groups to compare, each with scores (seeds,) by task.
        resamples: number of resamples.
        confidence: confidence level of the interval.
        seed: random seed.
    """
    return estimates([statistic], *groups, resamples=resamples, confidence=confidence, seed=seed)[0]


def estimates(
    statistics: Sequence[Statistic],
    *groups: Strata,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> list[Estimate]:
    """Returns several statistics with intervals from the same resamples; see `estimate`."""
    if min(seeds.shape[-1] for strata in groups for seeds in strata) == 0:
        return [Estimate(np.nan, np.nan, np.nan, np.nan)] * len(statistics)
    values = [float(statistic(*groups)) for statistic in statistics]
    if min(seeds.shape[-1] for strata in groups for seeds in strata) < MIN_SEEDS:
        return [Estimate(value, np.nan, np.nan, np.nan) for value in values]
    drawn = bootstrap(statistics, *groups, resamples=resamples, seed=seed)
    return [_with_interval(*pair, confidence) for pair in zip(values, drawn, strict=True)]


def _with_interval(value: float, drawn: FloatArray, confidence: float) -> Estimate:
    # Seeds that never reach a threshold have infinite scores, which can't be interpolated.
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
    """Returns the control steps (seeds,) after which each seed first reaches a return.

    A seed that never does counts as infinity: its true value is later than its end.

    Args:
        returns: (seeds, points) smoothed episode returns; NaN after a run's end.
        control_steps: (points,) or (seeds, points).
        threshold: the return to reach.
    """
    reached = np.nan_to_num(returns, nan=-np.inf) >= threshold
    first = np.argmax(reached, axis=1)
    steps = np.broadcast_to(control_steps, returns.shape)
    first_steps = np.take_along_axis(steps, first[:, None], axis=1)[:, 0]
    return np.where(reached.any(axis=1), first_steps, np.inf)


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns the seeds per group that decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the true effect is assumed to
    equal the observed one (Cohen, 1988, chapter 2, by the normal approximation).

    Args:
        distance: distance of the effect from the deciding value.
        standard_error: standard error of the effect at the present number of seeds.
        seeds: present number of seeds per group.

    Returns:
        None if the distance is 0 or unknown, or if more than a million seeds were needed.
    """
    if not (np.isfinite(distance) and np.isfinite(standard_error)) or distance == 0:
        return None
    root = abs((_SIGNIFICANCE + _POWER) * standard_error / distance)
    if root > np.sqrt(_MAX_SEEDS / seeds):
        return None
    return max(MIN_SEEDS, int(np.ceil(seeds * root**2)))


def _over_tasks(average: Callable[..., FloatArray], values: Sequence[FloatArray]) -> FloatArray:
    return average(values, axis=0)


def _pooled(strata: Strata) -> FloatArray:
    return np.concatenate(list(strata), axis=-1)


def _range(strata: Strata, low: float, high: float) -> FloatArray:
    ends = np.percentile(_pooled(strata), (low, high), axis=-1)
    width: FloatArray = ends[1] - ends[0]
    return width


def _sum_of_ranks(values: FloatArray, first: int) -> FloatArray:
    """Returns the sum of the ranks (from 1) of the first `first` values of the last axis.

    Equal values share the mean of their ranks.
    """
    order = np.argsort(values, axis=-1)
    ordered = np.take_along_axis(values, order, axis=-1)
    positions = np.arange(values.shape[-1])
    new = np.ones(values.shape, bool)
    new[..., 1:] = ordered[..., 1:] != ordered[..., :-1]
    last = np.ones(values.shape, bool)
    last[..., :-1] = new[..., 1:]
    lowest = np.maximum.accumulate(np.where(new, positions, 0), axis=-1)
    backwards = np.where(last, positions, values.shape[-1])[..., ::-1]
    highest = np.minimum.accumulate(backwards, axis=-1)[..., ::-1]
    total: FloatArray = np.sum((1 + (lowest + highest) / 2) * (order < first), axis=-1)
    return total


def _resampled(seeds: FloatArray, resamples: int, random: np.random.Generator) -> FloatArray:
    count = len(seeds)
    chosen: NDArray[np.int64] = random.integers(count, size=(resamples, count))
    return seeds[chosen]
