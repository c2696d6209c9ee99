"""How much the agents of a configuration differ, beyond what their episodes alone cause.

An agent is a trained run, one per seed. The return of episode j of agent i is mu + A_i + e_ij,
where A_i has the standard deviation s across agents and e_ij the standard deviation w across the
episodes of an agent (a one-way random-effects model; S. R. Searle, G. Casella, C. E. McCulloch,
*Variance Components*, 1992, chapter 3). All deviations are in points of return.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, nctdtrinc, stdtrit

from jbench.statistics import FloatArray
from jbench.statistics.bootstrap import MIN_SEEDS, Estimate


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
        deviation: s; 0 if the estimate of s^2 is negative.
        low: lower end of the interval of s.
        high: upper end.
        episode_deviation: w, the root of the mean variance of an agent's episodes.
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
    if not agents.known:
        return Components()
    means, episodes = agents.episode_variance + agents.agent_variance, agents.episode_variance
    freedom = len(agents.means) - 1, _episode_freedom(agents.episodes)
    tail = (1 - confidence) / 2
    ends = (means / fdtri(*freedom, at) - episodes for at in (1 - tail, tail))
    low, high = (float(np.sqrt(max(end, 0))) for end in ends)
    return Components(
        deviation=float(np.sqrt(max(agents.agent_variance, 0))),
        low=low,
        high=high,
        episode_deviation=float(np.sqrt(np.mean(agents.variances * agents.episodes))),
    )


def difference(ours: Agents, theirs: Agents, confidence: float = 0.95) -> Estimate:
    """Returns the difference of two configurations in s, ours minus theirs; NaN if it is unknown.

    The interval combines the two intervals of s (G. Y. Zou, A. Donner, *Construction of confidence
    limits about effect measures: a general approach*, Stat. Med. 27, 2008).
    """
    if not (ours.known and theirs.known):
        return Estimate(np.nan)
    s, t = components(ours, confidence), components(theirs, confidence)
    value = s.deviation - t.deviation
    low = value - np.hypot(s.deviation - s.low, t.high - t.deviation)
    high = value + np.hypot(s.high - s.deviation, t.deviation - t.low)
    return Estimate(value, float(low), float(high))


def smallest_difference(
    seeds: int, deviation: float, episode_deviation: float, episodes: float
) -> float:
    """Returns the smallest difference of means that two equal configurations can show.

    It is the true difference that a two-sided Welch test finds at 5% with a power of 80%.

    Args:
        seeds: of each configuration.
        deviation: s.
        episode_deviation: w.
        episodes: per agent; may be infinite.
    """
    variance = (deviation**2 + episode_deviation**2 / episodes) / seeds
    if variance == 0:
        return 0.0
    freedom = 2 * (seeds - 1)
    boundary = stdtrit(freedom, 0.975)
    return float(nctdtrinc(freedom, 0.2, boundary) * np.sqrt(2 * variance))


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns the seeds per group that decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the true effect is assumed to
    equal the observed one (Cohen, 1988, chapter 2, by the normal approximation).

    Args:
        distance: of the effect from the deciding value.
        standard_error: of the effect at the present number of seeds.
        seeds: present number of seeds per group.

    Returns:
        None if the distance is 0 or unknown, or if more than a million seeds were needed.
    """
    if not np.isfinite([distance, standard_error]).all() or distance == 0:
        return None
    # Quantiles of the normal distribution, for the test and for the power.
    root = abs((1.959964 + 0.841621) * standard_error / distance)
    if root > np.sqrt(1_000_000 / seeds):
        return None
    return max(MIN_SEEDS, int(np.ceil(seeds * root**2)))


def _episode_freedom(episodes: FloatArray) -> float:
    """Returns the degrees of freedom of `episode_variance`, for episodes of equal variance.

    The sum of the variances over episodes is treated as in Satterthwaite's approximation; for n
    episodes of each of k agents it has k (n - 1).
    """
    return float(np.sum(1 / episodes) ** 2 / np.sum(1 / (episodes**2 * (episodes - 1))))
