"""Tests of the variation between agents: numbers worked out by hand, and simulated agents."""

import numpy as np
import pytest
from scipy import stats

from jbench.statistics.agents import Agents, components, deviation_difference, smallest_difference


def agents_from(returns):
    """Agents with these returns of their episodes, (agents, episodes) or ragged."""
    means, counts = (np.array([f(row) for row in returns], float) for f in (np.mean, len))
    variances = [np.var(row, ddof=1) / len(row) if len(row) > 1 else np.nan for row in returns]
    return Agents(means, np.array(variances), counts)


# Means of 2, 5 and 10, each of two episodes with a sample variance of 2.
THREE = agents_from([[1, 3], [4, 6], [9, 11]])


def draw(random, agents, episodes, s, w):
    return s * random.normal(size=(agents, 1)) + w * random.normal(size=(agents, episodes))


def test_components_agree_with_numbers_worked_out_by_hand():
    estimated = components(THREE)
    # The variance of the means is 49 / 3; the episodes cause 2 / 2 of it.
    assert THREE.agent_variance == pytest.approx(49 / 3 - 1)
    assert estimated.deviation == pytest.approx((46 / 3) ** 0.5)
    assert estimated.episode_deviation == pytest.approx(2**0.5)
    assert THREE.episode_variance == pytest.approx(1)
    # F has 2 and 3 degrees of freedom: P(F > f) = (1 + 2 f / 3)^(-3/2), so its quantiles are
    # 3/2 (q^(-2/3) - 1) for an upper tail q.
    f = 49 / 3
    upper, lower = (1.5 * (q ** (-2 / 3) - 1) for q in (0.025, 0.975))
    assert estimated.low == pytest.approx((f / upper - 1) ** 0.5)
    assert estimated.high == pytest.approx((f / lower - 1) ** 0.5)


def test_negative_estimate_is_kept_and_deviation_is_zero():
    agents = agents_from([[0, 10], [1, 9], [2, 8]])  # equal means
    assert agents.agent_variance == pytest.approx(-(50 + 32 + 18) / 3 / 2)
    assert components(agents)[:3] == (0, 0, 0)


def test_single_agents_and_episodes_have_no_components():
    for unknown in ([[1], [2, 3]], [[1, 2]], []):
        assert np.isnan(components(agents_from(unknown))).all()
        assert np.isnan(deviation_difference(THREE, agents_from(unknown))).all()


def test_unequal_numbers_of_episodes_have_fewer_degrees_of_freedom():
    # Means 0 and 4; variances 2 / 2 and 2 / 8 of them; (1/2 + 1/8)^2 / (1/4 + 1/(64 * 7)) = 1.549.
    returns = [[-1, 1], 4 + np.repeat([-1, 1], 4) * 1.75**0.5]
    agents = agents_from(returns)
    assert agents.episode_variance == pytest.approx(0.625)
    assert components(agents).episode_deviation == pytest.approx(2**0.5)
    upper = stats.f(1, 1.549).isf(0.025)
    assert components(agents).low == pytest.approx(max(8 / upper - 0.625, 0) ** 0.5, abs=1e-2)


@pytest.mark.parametrize(("s", "episodes"), [(50, 10), (50, 100), (20, 30)])
def test_interval_covers_deviation_of_simulated_agents(s, episodes):
    random, repetitions = np.random.default_rng(s), 600
    agents = [agents_from(draw(random, 10, episodes, s, 150)) for _ in range(repetitions)]
    estimated = list(map(components, agents))
    covered = np.mean([interval.low <= s <= interval.high for interval in estimated])
    # Three standard errors are 0.027.
    assert 0.95 - 0.027 < covered < 0.95 + 0.027
    assert np.mean([sample.agent_variance for sample in agents]) == pytest.approx(s**2, rel=0.15)


def test_difference_is_found_and_equal_agents_are_not_different():
    random = np.random.default_rng(3)
    steady, varying = (agents_from(draw(random, 20, 100, s, 100)) for s in (20, 100))
    estimated = deviation_difference(varying, steady)
    # The estimate of a deviation of 100 by 20 agents varies by 100 / sqrt(38) = 16 (one sd).
    assert estimated.value == pytest.approx(80, abs=40)
    assert 0 < estimated.low < estimated.value < estimated.high
    wider = deviation_difference(varying, steady, confidence=0.999)
    assert wider.low < estimated.low < estimated.high < wider.high
    swapped = deviation_difference(steady, varying)
    assert swapped[:3] == pytest.approx((-estimated.value, -estimated.high, -estimated.low))
    assert deviation_difference(steady, steady).value == 0


def test_smallest_difference_agrees_with_tables_of_power():
    # Cohen, 1988, table 2.4.1: 64 and 26 seeds for effects of 0.5 and 0.8 at a power of 80%.
    assert smallest_difference(64, 100, 0, 10) == pytest.approx(50, abs=0.5)
    assert smallest_difference(26, 100, 0, 10) == pytest.approx(80, abs=1)
    # Episodes add w^2 / n: 60^2 + 80^2 = 100^2.
    assert smallest_difference(26, 60, 240, 9) == smallest_difference(26, 100, 0, 9)
    # One seed, or none, has no variance.
    assert np.isnan([smallest_difference(seeds, 100, 0, 9) for seeds in (0, 1)]).all()
