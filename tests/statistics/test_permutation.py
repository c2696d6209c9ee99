"""Tests of permutation tests, against scipy and numbers worked out by hand."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy import stats

from jbench.statistics.permutation import RELABELINGS_OF_TEN_SEEDS, p_value


def difference_of_means(ours, theirs, axis):
    return ours.mean(axis=axis) - theirs.mean(axis=axis)


@pytest.mark.parametrize(("ours", "theirs"), [(6, 6), (3, 7), (9, 9)])
def test_relabelings_are_those_of_scipy(ours, theirs):
    random = np.random.default_rng(3)
    # Whole numbers, so that relabelings are tied with the observed division.
    x = random.integers(0, 20, ours).astype(float) + 4
    y = random.integers(0, 20, theirs).astype(float)
    scipys = stats.permutation_test(
        (x, y), difference_of_means, vectorized=True, n_resamples=np.inf
    )
    # scipy doubles the smaller tail, which is another p-value if sizes differ.
    as_large = np.abs(scipys.null_distribution) >= abs(scipys.statistic) - 1e-9
    assert p_value([x], [y]) == pytest.approx(as_large.mean(), abs=1e-12)


def test_separated_groups_have_the_least_p_value():
    low = np.arange(6.0)
    # Of 924 relabelings, the observed one and its opposite differ as much.
    assert p_value([low + 100], [low]) == pytest.approx(2 / 924)
    assert p_value([low], [low]) == 1.0
    # Larger groups: none of the sampled relabelings.
    low = np.arange(20.0)
    assert p_value([low + 100], [low]) == pytest.approx(1 / (RELABELINGS_OF_TEN_SEEDS + 1))


def test_the_order_of_seeds_and_earlier_tests_of_equal_scores_change_no_p_value():
    # Ranks of two times six seeds, as most comparisons have them: 1 to 12.
    divisions = [range(1, 7), [1, 2, 3, 4, 5, 12], [12, 1, 5, 3, 2, 4], range(7, 13), range(1, 7)]
    p_values = []
    for chosen in divisions:
        others = [rank for rank in range(12, 0, -1) if rank not in chosen]
        p_values.append(p_value([np.array(chosen, float)], [np.array(others, float)]))
    # By hand: as far apart as 21 of 78 are 2 of 924 divisions. A sum of 27 or less: 1, 1, 2, 3, 5,
    # 7 and 11 divisions have 21, 22, ... 27.
    assert p_values == pytest.approx([2 / 924, 60 / 924, 60 / 924, 2 / 924, 2 / 924])


def test_seeds_are_exchanged_within_tasks_only():
    ours = [np.array([5.0, 9, 7]), np.array([130.0, 90, 101])]
    theirs = [np.array([2.0, 6, 1]), np.array([100.0, 80, 97])]

    def differences(task):
        pooled = np.concatenate([ours[task], theirs[task]])
        halves = [pooled[list(chosen)] for chosen in combinations(range(6), 3)]
        return [2 * half.mean() - pooled.mean() * 2 for half in halves]

    observed = sum(x.mean() - y.mean() for x, y in zip(ours, theirs, strict=True))
    every = np.array([abs(sum(each)) for each in product(differences(0), differences(1))])
    expected = (every >= observed - 1e-9).mean()
    error = np.sqrt(expected * (1 - expected) / RELABELINGS_OF_TEN_SEEDS)
    assert p_value(ours, theirs) == pytest.approx(expected, abs=4 * error)


def test_a_difference_of_means_confirms_no_number_of_another_sign():
    # Of twenty seeds five fail: the interquartile mean is higher by 20, the mean lower by 210.
    ours = np.r_[np.full(5, -110.0), np.full(15, 820.0)]
    theirs = np.full(20, 800.0)
    assert stats.trim_mean(ours, 0.25) - 800 == 20
    # All failed ones are on one side in 2 (20 over 5) / (40 over 5) divisions, which are sampled.
    assert p_value([ours], [theirs]) == pytest.approx(2 * 15_504 / 658_008, abs=0.003)
    assert p_value([ours], [theirs], -212.5) == p_value([ours], [theirs])
    assert p_value([ours], [theirs], 20.0) == 1.0


def test_scores_that_are_not_finite_decide_nothing():
    low = np.arange(6.0)
    assert p_value([np.append(low[:5], np.inf) + 100], [low]) == 1.0


def test_error_rate_of_few_seeds_holds_at_a_corrected_level():
    # A seed in seven fails. Of 2,000 equal configurations, 0.5% is 10, give or take 3.
    random = np.random.default_rng(0)
    scores = np.where(random.random((2000, 14)) < 1 / 7, 100, random.normal(800, 50, (2000, 14)))
    found = sum(p_value([row[:7]], [row[7:]]) <= 0.005 for row in scores)
    assert found <= 20
