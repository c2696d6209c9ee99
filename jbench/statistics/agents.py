"""How much the agents of a configuration differ, beyond what their episodes alone cause.

An agent is a trained run, one per seed. The return of episode j of agent i is mu + A_i + e_ij,
where A_i has the standard deviation s across agents and e_ij the standard deviation w across the
episodes of an agent (a one-way random-effects model; S. R. Searle, G. Casella, C. E. McCulloch,
*Variance Components*, 1992, chapter 3). All deviations are in points of return.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, nctdtrinc, stdtrit

from jbench.array_types import FloatArray
from jbench.statistics.bootstrap import MIN_SEEDS, Estimate


class Agents(NamedTuple):
    """What is known of the agents of a configuration from their episodes."""

    means: FloatArray  # (agents,) mean return of the episodes of each
    variances: FloatArray  # (agents,) sample variance of the episodes, divided by their number
    episodes: FloatArray  # (agents,) number

    @property
    def episode_variance(self) -> float:
        """Mean of `variances`: the variance of the means if all agents were equally good."""
        return float(np.mean(self.variances))

    @property
    def agent_variance(self) -> float:
        """Unbiased estimate of s^2, the variance between agents; it can be negative."""
        return float(np.var(self.means, ddof=1)) - self.episode_variance

    @property
    def is_known(self) -> bool:
        """Whether there are two or more agents with two or more episodes each."""
        enough = np.isfinite(self.variances) & (self.episodes > 1)
        return len(enough) > 1 and bool(enough.all())


class Components(NamedTuple):
    """Deviation s, with its interval, and w, that of the episodes; NaN if they are unknown.

    s is 0 if the estimate of s^2 is negative; w^2 is the mean variance of an agent's episodes.
    """

    deviation: float = np.nan
    low: float = np.nan
    high: float = np.nan
    episode_deviation: float = np.nan


def components(agents: Agents, confidence: float = 0.95) -> Components:
    """Estimates s and w, with an interval of s that is exact for normal returns and equal numbers.

    The interval inverts the F test of the variance of the means against that of the episodes. For
    unequal numbers of episodes this is that of J. D. Thomas and R. A. Hultquist (*Interval
    estimation for the unbalanced case of the one-way random effects model*, Ann. Statist. 6, 1978).
    """
    if not agents.is_known:
        return Components()

    counts = agents.episodes
    within = agents.episode_variance
    between = agents.agent_variance
    # As in Satterthwaite's approximation; k (n - 1) for n episodes of each of k agents.
    freedom = float(np.sum(1 / counts) ** 2 / np.sum(1 / (counts**2 * (counts - 1))))
    tail = (1 - confidence) / 2

    def squared_end(probability: float) -> float:
        """Returns s^2 at which the F statistic is the quantile of a probability."""
        quantile = fdtri(len(counts) - 1, freedom, probability)  # of numpy: 0 gives infinity
        return float((within + between) / quantile - within)

    return Components(
        deviation=_root(between),
        low=_root(squared_end(1 - tail)),
        high=_root(squared_end(tail)),
        episode_deviation=_root(float(np.mean(agents.variances * counts))),
    )


def _root(square: float) -> float:
    """Returns the square root, 0 of a negative estimate of a variance."""
    return float(np.sqrt(max(square, 0)))


def deviation_difference(ours: Agents, theirs: Agents, confidence: float = 0.95) -> Estimate:
    """Returns the difference of two configurations in s, ours minus theirs; NaN if it is unknown.

    The interval combines the two intervals of s (G. Y. Zou, A. Donner, *Construction of confidence
    limits about effect measures: a general approach*, Stat. Med. 27, 2008).
    """
    s = components(ours, confidence)
    t = components(theirs, confidence)
    value = s.deviation - t.deviation
    low = value - np.hypot(s.deviation - s.low, t.high - t.deviation)
    high = value + np.hypot(s.high - s.deviation, t.deviation - t.low)
    return Estimate(value, float(low), float(high))


def smallest_difference(
    seeds: int, deviation: float, episode_deviation: float, episodes: float
) -> float:
    """Returns the smallest difference of means that two equal configurations can show.

    It is the true difference that a two-sided Welch test finds at 5% with a power of 80%, from
    seeds per configuration, s, w and episodes per agent (which may be infinite). NaN for fewer than
    two seeds, which have no variance.
    """
    if seeds < 2:
        return np.nan

    variance = (deviation**2 + episode_deviation**2 / episodes) / seeds
    freedom = 2 * (seeds - 1)
    return float(nctdtrinc(freedom, 0.2, stdtrit(freedom, 0.975)) * np.sqrt(2 * variance))


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns the seeds per group that decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the true effect is assumed to
    equal the observed one (Cohen, 1988, chapter 2, by the normal approximation). None: the distance
    is 0 or unknown, or more than a million seeds were needed.

    Args:
        distance: of the effect from the deciding value.
        standard_error: of the effect at the present number of seeds per group.
    """
    if not np.isfinite([distance, standard_error]).all() or distance == 0:
        return None
    # Quantiles of the normal distribution, for the test and for the power.
    root = abs((1.959964 + 0.841621) * standard_error / distance)
    if root > np.sqrt(1_000_000 / seeds):
        return None
    return max(MIN_SEEDS, int(np.ceil(seeds * root**2)))
