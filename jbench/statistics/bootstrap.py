"""Estimates with bootstrap intervals, following Agarwal et al. (2021).

Seeds are the only unit of replication: values within a run are averaged first. Tasks are strata: a
resample draws seeds with replacement within each task, never across tasks.

Every statistic takes a list of strata, each (..., seeds) with the same leading axes, and returns
(...). Without leading axes it returns the estimate; with an axis of resamples, the bootstrap
distribution.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from jbench.array_types import FloatArray, IntArray

Strata = Sequence[FloatArray]  # scores (..., seeds) per task
Statistic = Callable[..., FloatArray]
"""Takes as many `Strata` as there are groups to compare; returns (...)."""

RESAMPLES = 10_000
MIN_SEEDS = 3
"""Minimum number of seeds per stratum for an interval, and for a band around a curve."""

_LEAST_WEIGHT = 1e-12
"""Weights of scores that are less are rounding errors: the weights of all scores add up to 1."""


class Estimate(NamedTuple):
    """A number with its uncertainty, which is NaN with fewer than `MIN_SEEDS` seeds.

    `value` is the statistic of all seeds, `low` to `high` its interval, whose ends may be infinite,
    and `standard_error` the standard deviation of its bootstrap distribution; NaN if that has
    numbers that are not finite.
    """

    value: float
    low: float = np.nan
    high: float = np.nan
    standard_error: float = np.nan


def mean(strata: Strata) -> FloatArray:
    """Returns the mean over the values of all strata."""
    return np.asarray(np.mean(_pooled(strata), axis=-1))


def median(strata: Strata) -> FloatArray:
    """Returns the median over the seeds of all tasks."""
    ordered = np.sort(_pooled(strata), axis=-1)  # numpy's median is slower
    count = ordered.shape[-1]
    return np.asarray((ordered[..., (count - 1) // 2] + ordered[..., count // 2]) / 2)


def interquartile_mean(strata: Strata) -> FloatArray:
    """Returns the mean without the lowest and highest quarter.

    Of n scores, n // 4 are left out at each end (Agarwal et al., 2021, section 4.3). Every task
    counts the same: where tasks have different numbers of seeds, scores have different weights, and
    the same share of all weights is left out.
    """
    scores = _pooled(strata)
    sizes = [seeds.shape[-1] for seeds in strata]
    count = sum(sizes)
    if len({*sizes}) == 1:
        ordered = np.sort(scores, axis=-1)
        return np.asarray(np.mean(ordered[..., count // 4 : count - count // 4], axis=-1))

    weights = np.concatenate([np.full(n, 1 / n / len(sizes)) for n in sizes])
    order = np.argsort(scores, axis=-1)
    ends = np.cumsum(weights[order], axis=-1)
    low = count // 4 / count
    kept = np.clip(ends, low, 1 - low) - np.clip(ends - weights[order], low, 1 - low)
    ordered = np.take_along_axis(scores, order, axis=-1)
    # An infinite score that is left out counts nothing; 0 times infinity would be NaN.
    is_left_out = np.isinf(ordered) & (kept < _LEAST_WEIGHT)
    sums = np.sum(kept * np.where(is_left_out, 0.0, ordered), axis=-1)
    return np.asarray(sums / (1 - 2 * low))


def standard_deviation(strata: Strata) -> FloatArray:
    """Returns the standard deviation (of n - 1) over the seeds of all tasks; NaN for one seed."""
    scores = _pooled(strata)
    if scores.shape[-1] < 2:
        return np.full(scores.shape[:-1], np.nan)
    return np.asarray(np.std(scores, axis=-1, ddof=1))


def probability_of_improvement(ours: Strata, theirs: Strata) -> FloatArray:
    """Returns the probability that a run of ours beats one of theirs, averaged over tasks.

    Ties count half. It is the Mann-Whitney U statistic as a share of all pairs (Agarwal et al.,
    2021, section 4.3).
    """
    won = [_won(x, y).mean(axis=(-2, -1)) for x, y in zip(ours, theirs, strict=True)]
    return np.asarray(np.mean(won, axis=0))


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
    return np.asarray(np.mean(shares, axis=0))


def profile_interval(
    strata: Strata, thresholds: FloatArray, resamples: int = 1000
) -> tuple[FloatArray, FloatArray]:
    """Returns the ends of the 95% interval of a profile at each threshold.

    The number of n resampled seeds above a threshold has a binomial distribution, so that no seeds
    need to be resampled.
    """
    random = np.random.default_rng(0)
    drawn = np.zeros((resamples, len(thresholds)))
    for seeds in strata:
        share = performance_profile([seeds], thresholds)
        drawn += random.binomial(len(seeds), share, drawn.shape) / len(seeds) / len(strata)
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return low, high


class Resampled(NamedTuple):
    """A statistic and its bootstrap distribution, from which intervals of any level follow.

    `value` is the statistic of all seeds, `drawn` (resamples,) that of resampled seeds, empty for
    fewer than `MIN_SEEDS`.
    """

    value: float
    drawn: FloatArray

    def estimate(self, confidence: float = 0.95) -> Estimate:
        """Returns the statistic with its interval of percentiles.

        A resample may have no value, such as a ratio of 0 to 0. It counts as -inf for the lower end
        and as +inf for the upper end, so the interval is unbounded if more resamples have none than
        an end leaves out: 2.5% for a confidence of 95%.
        """
        drawn = self.drawn
        if not len(drawn):
            return Estimate(self.value)

        tail = (1 - confidence) / 2
        if np.isfinite(drawn).all():
            low, high = np.quantile(drawn, [tail, 1 - tail])
            return Estimate(self.value, float(low), float(high), float(np.std(drawn)))

        # Seeds that never reach a threshold have infinite scores, which can't be interpolated.
        has_none = np.isnan(drawn)
        low = np.quantile(np.where(has_none, -np.inf, drawn), tail, method="higher")
        high = np.quantile(np.where(has_none, np.inf, drawn), 1 - tail, method="higher")
        return Estimate(self.value, float(low), float(high))


def samples(
    statistics: Sequence[Statistic], *groups: Strata, resamples: int = RESAMPLES
) -> list[Resampled]:
    """Returns several statistics of the same resamples (stratified bootstrap).

    Groups have scores (seeds,) by task, and are resampled independently within each task.
    """
    fewest = min(seeds.shape[-1] for strata in groups for seeds in strata)
    values = [float(statistic(*groups)) if fewest else np.nan for statistic in statistics]
    if fewest < MIN_SEEDS:
        return [Resampled(value, np.empty(0)) for value in values]

    sizes = tuple(tuple(len(seeds) for seeds in strata) for strata in groups)
    drawn = _drawn(groups, _chosen(sizes, resamples))
    resampled = []
    for statistic, value in zip(statistics, values, strict=True):
        if statistic is probability_of_improvement:
            # The same numbers: comparing all pairs of seeds in each resample would take most of the
            # time of a report.
            distribution = _improvements(groups, _counts(sizes, resamples))
        else:
            distribution = statistic(*drawn)
        resampled.append(Resampled(value, distribution))

    return resampled


def estimate(statistic: Statistic, *groups: Strata, resamples: int = RESAMPLES) -> Estimate:
    """Returns a statistic with its interval; see `samples`."""
    return samples([statistic], *groups, resamples=resamples)[0].estimate()


def _pooled(strata: Strata) -> FloatArray:
    """Returns the scores of all strata together (…, n)."""
    return strata[0] if len(strata) == 1 else np.concatenate(list(strata), axis=-1)


def _won(x: FloatArray, y: FloatArray) -> FloatArray:
    """Returns whether each score of x (..., n) beats each of y (..., m): 1, 0.5 or 0."""
    ours = x[..., :, None]
    theirs = y[..., None, :]
    return np.asarray((ours > theirs) + 0.5 * (ours == theirs))


def _drawn(
    groups: Sequence[Strata], chosen: Sequence[Sequence[IntArray]]
) -> list[list[FloatArray]]:
    """Returns the scores of the chosen seeds, (resamples, seeds) by group and task."""
    return [
        [seeds[index] for seeds, index in zip(strata, indices, strict=True)]
        for strata, indices in zip(groups, chosen, strict=True)
    ]


@lru_cache(maxsize=4)
def _chosen(sizes: tuple[tuple[int, ...], ...], resamples: int) -> list[list[IntArray]]:
    """Returns which seeds resamples have, (resamples, seeds) by group and task.

    They depend on the numbers of seeds only, of which a report has few, and hundreds of comparisons
    of each.

    Args:
        sizes: numbers of seeds by group and task.
    """
    random = np.random.default_rng(0)
    return [[random.integers(size, size=(resamples, size)) for size in group] for group in sizes]


@lru_cache(maxsize=4)
def _counts(sizes: tuple[tuple[int, ...], ...], resamples: int) -> list[list[FloatArray]]:
    """Returns how often resamples have each seed, (resamples, seeds) by group and task."""
    return [[_count(index) for index in indices] for indices in _chosen(sizes, resamples)]


def _count(index: IntArray) -> FloatArray:
    """Returns how often each row (resamples, seeds) of indices has each seed."""
    rows = np.arange(len(index))[:, None] * index.shape[1]
    flat = np.bincount((rows + index).ravel(), minlength=index.size)
    return flat.reshape(index.shape).astype(np.float64)


def _improvements(groups: Sequence[Strata], counts: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Returns `probability_of_improvement` of each resample, from how often it has each seed."""
    shares = []
    for x, y, ours, theirs in zip(*groups, *counts, strict=True):
        # Sums of halves have no rounding errors.
        won = np.einsum("ij,ij->i", ours @ _won(x, y), theirs)
        shares.append(won / (len(x) * len(y)))

    return np.asarray(np.mean(shares, axis=0))
