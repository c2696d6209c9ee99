"""How much the agents of a configuration differ, beyond what their episodes alone cause.

An agent is a trained run, one per seed. The return of episode j of agent i is mu + A_i + e_ij,
where A_i has the standard deviation s across agents and e_ij the standard deviation w across the
episodes of an agent (a one-way random-effects model; S. R. Searle, G. Casella, C. E. McCulloch,
*Variance Components*, 1992, chapter 3). All deviations are in points of return.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import fdtrc, fdtri, nctdtrinc, stdtrit

FloatArray = NDArray[np.float64]

RELABELINGS = 10_000
"""Relabelings of a permutation test, the observed one included."""

_MOST = 1_000_000  # limit of recommended seeds or episodes


class Agents(NamedTuple):
    """Mean returns of agents.

    Attributes:
        means: (agents,) mean return of each agent's episodes.
        variances: (agents,) sample variance of its episodes, divided by their number.
        episodes: (agents,) number of its episodes.
    """

    means: FloatArray
    variances: FloatArray
    episodes: FloatArray

    @property
    def episode_variance(self) -> float:
        """Mean of `variances`: the variance of the means if all agents were equally good."""
        return float(np.mean(self.variances))

    @property
    def agent_variance(self) -> float:
        """Unbiased estimate of s^2, the variance between agents; it can be negative."""
        return float(np.var(self.means, ddof=1)) - self.episode_variance

    @property
    def known(self) -> bool:
        """Whether there are two or more agents with two or more episodes each."""
        return len(self.means) > 1 and bool(
            np.isfinite(self.variances).all() and (self.episodes > 1).all()
        )


class Components(NamedTuple):
    """Components of the variance of returns; NaN if they are unknown.

    Attributes:
        variance: estimate of s^2, not truncated at 0.
        deviation: s; 0 if the estimate of s^2 is negative.
        low: lower end of the 95% interval of s.
        high: upper end.
        episode_deviation: w, the root of the mean variance of an agent's episodes.
        by_episodes: standard deviation of the means that the episodes alone would cause.
        p: of the test that all agents have the same expected return (s = 0).
        reliability: share of the variance of the means that is due to the agents.
    """

    variance: float = np.nan
    deviation: float = np.nan
    low: float = np.nan
    high: float = np.nan
    episode_deviation: float = np.nan
    by_episodes: float = np.nan
    p: float = np.nan
    reliability: float = np.nan


class Difference(NamedTuple):
    """Difference of two configurations in s, ours minus theirs; NaN if it is unknown.

    Attributes:
        value: difference in points of return.
        low: lower end of its 95% interval.
        high: upper end.
        p: of the permutation test that s is equal.
    """

    value: float = np.nan
    low: float = np.nan
    high: float = np.nan
    p: float = np.nan


def agents_from(returns: Iterable[ArrayLike]) -> Agents:
    """Returns the mean returns of agents from those of their episodes.

    Args:
        returns: per agent, the returns (episodes,) of one evaluation; NaN for no episode, so that
            an array (agents, episodes) will do. An agent without episodes is left out.
    """
    rows = [np.asarray(row, np.float64) for row in returns]
    rows = [row[np.isfinite(row)] for row in rows]
    rows = [row for row in rows if len(row)]
    variances = [row.var(ddof=1) / len(row) if len(row) > 1 else np.nan for row in rows]
    means = np.array([row.mean() for row in rows])
    return Agents(means, np.array(variances), np.array([len(row) for row in rows], np.float64))


def components(agents: Agents, confidence: float = 0.95) -> Components:
    """Estimates s and w, with an interval of s that is exact for normal returns and equal numbers.

    The interval inverts the F test of the variance of the means against that of the episodes. For
    unequal numbers of episodes this is that of J. D. Thomas and R. A. Hultquist (*Interval
    estimation for the unbalanced case of the one-way random effects model*, Ann. Statist. 6, 1978).
    """
    if not agents.known:
        return Components()
    means, episodes = agents.episode_variance + agents.agent_variance, agents.episode_variance
    freedom = len(agents.means) - 1, _episode_freedom(agents.episodes)
    tail = (1 - confidence) / 2
    ends = (means / fdtri(*freedom, at) - episodes for at in (1 - tail, tail))
    low, high = (float(np.sqrt(max(end, 0))) for end in ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.divide(means, episodes)
    return Components(
        variance=agents.agent_variance,
        deviation=_root(agents.agent_variance),
        low=low,
        high=high,
        episode_deviation=float(np.sqrt(np.mean(agents.variances * agents.episodes))),
        by_episodes=float(np.sqrt(episodes)),
        p=float(fdtrc(*freedom, f)) if means > 0 else 1.0,
        reliability=max(agents.agent_variance, 0) / means if means > 0 else 0.0,
    )


def difference(ours: Agents, theirs: Agents) -> Difference:
    """Compares s of two configurations.

    The interval combines the two intervals of s (G. Y. Zou, A. Donner, *Construction of confidence
    limits about effect measures: a general approach*, Stat. Med. 27, 2008). The test permutes the
    agents' means, centered by the median of their configuration (M. B. Brown, A. B. Forsythe,
    *Robust tests for the equality of variances*, JASA 69, 1974). Since the variation of the
    episodes may differ, each mean is divided by the standard deviation that it has if s is equal,
    and multiplied by that of the configuration in which it comes to be; then the part of the
    episodes is subtracted.
    """
    if not (ours.known and theirs.known):
        return Difference()
    s, t = components(ours), components(theirs)
    value = s.deviation - t.deviation
    low = value - np.hypot(s.deviation - s.low, t.high - t.deviation)
    high = value + np.hypot(s.high - s.deviation, t.deviation - t.low)
    return Difference(value, float(low), float(high), _permutation_p(ours, theirs))


def smallest_difference(
    seeds: ArrayLike,
    deviation: ArrayLike,
    episode_deviation: ArrayLike,
    episodes: ArrayLike,
    *,
    error_rate: float = 0.05,
    power: float = 0.8,
) -> float:
    """Returns the smallest difference of means that a pair of configurations can show.

    It is the true difference that a two-sided Welch test finds with this power.

    Args:
        seeds: of each configuration. Every number is that of both, or a pair.
        deviation: s.
        episode_deviation: w.
        episodes: per agent; may be infinite.
    """
    numbers = np.broadcast_arrays(seeds, deviation, episode_deviation, episodes, np.zeros(2))
    k, s, w, n, _ = (np.asarray(one, np.float64) for one in numbers)
    parts = (s**2 + w**2 / n) / k
    if parts.sum() == 0:
        return 0.0
    freedom = parts.sum() ** 2 / np.sum(parts**2 / (k - 1))
    boundary = stdtrit(freedom, 1 - error_rate / 2)
    return float(nctdtrinc(freedom, 1 - power, boundary) * np.sqrt(parts.sum()))


def seeds_needed(
    effect: float, deviation: ArrayLike, episode_deviation: ArrayLike, episodes: ArrayLike
) -> int | None:
    """Returns the seeds per configuration that show a difference of means; see above.

    Args:
        effect: the difference, or its distance from the value that decides.

    Returns:
        None if a million seeds don't, or a number is unknown.
    """
    return _fewest(
        lambda seeds: smallest_difference(seeds, deviation, episode_deviation, episodes), effect
    )


def episodes_needed(
    effect: float, seeds: ArrayLike, deviation: ArrayLike, episode_deviation: ArrayLike
) -> int | None:
    """Returns the episodes per agent that show a difference of means with these seeds.

    Returns:
        None if no number of episodes does, because the agents differ too much.
    """
    return _fewest(
        lambda episodes: smallest_difference(seeds, deviation, episode_deviation, episodes), effect
    )


def _root(variance: float) -> float:
    return float(np.sqrt(max(variance, 0)))


def _episode_freedom(episodes: FloatArray) -> float:
    """Returns the degrees of freedom of `episode_variance`, for episodes of equal variance.

    The sum of the variances over episodes is treated as in Satterthwaite's approximation; for n
    episodes of each of k agents it has k (n - 1).
    """
    return float(np.sum(1 / episodes) ** 2 / np.sum(1 / (episodes**2 * (episodes - 1))))


def _permutation_p(ours: Agents, theirs: Agents) -> float:
    """Returns the p-value (two-sided) of the test of equal s; see `difference`."""
    groups = ours, theirs
    sizes = [len(group.means) for group in groups]
    common = max(0.0, float(np.average([g.agent_variance for g in groups], weights=sizes)))
    expected = [common + group.episode_variance for group in groups]
    if min(expected) == 0:
        return 1.0
    squares = np.concatenate(
        [(g.means - np.median(g.means)) ** 2 / e for g, e in zip(groups, expected, strict=True)]
    )
    random = np.random.default_rng(0)
    labels = np.tile(np.arange(len(squares)) < sizes[0], (RELABELINGS, 1))
    labels[1:] = random.permuted(labels[1:], axis=1)
    first = labels @ squares
    sums = first, squares.sum() - first
    estimates = [
        expected[i] * sums[i] / (sizes[i] - 1) - groups[i].episode_variance for i in range(2)
    ]
    statistic = np.abs(estimates[0] - estimates[1])
    return float(np.mean(statistic >= statistic[0] * (1 - 1e-9)))


def _fewest(smallest: Callable[[int], float], effect: float) -> int | None:
    """Returns the smallest number from 2 on with which an effect can be shown, by bisection."""
    if not smallest(_MOST) <= abs(effect):
        return None
    low, high = 1, _MOST
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if smallest(middle) <= abs(effect) else (middle, high)
    return high
