"""Tests of statistics across seeds against rliable, numpy and hand-computed numbers."""

import json
from pathlib import Path

import numpy as np
import pytest

from jbench.statistics import bootstrap as st
from jbench.statistics.agents import seeds_to_decide

_MADE = json.loads((Path(__file__).parent / "rliable_oracle" / "made.json").read_text())
CASES = _MADE["cases"]


def mean(tasks):
    """Returns the mean over tasks of the mean over seeds, a statistic that needs no sorting."""
    return np.mean([np.mean(seeds, axis=-1) for seeds in tasks], axis=0)


STATISTICS = {
    "mean": mean,
    "interquartile_mean": st.interquartile_mean,
    "probability_of_improvement": st.probability_of_improvement,
}


def strata(matrix):
    """Returns an array of seeds for each task, from rliable's matrix of (runs, tasks)."""
    return list(np.array(matrix).T)


@pytest.mark.parametrize("name", STATISTICS)
@pytest.mark.parametrize("case", CASES)
def test_estimates_equal_rliable_and_intervals_agree_with_it(case, name):
    samples = [strata(case["x"])]
    if name == "probability_of_improvement":
        samples.append(strata(case["y"]))
    estimated = st.estimate(STATISTICS[name], *samples, resamples=20_000)
    assert estimated.value == pytest.approx(case["made"][name]["value"], abs=1e-9)
    low, high = case["made"][name]["interval"]
    # The limits of a bootstrap of 5,000 vary by about 2% of the width (one sd). The scores of half
    # of the cases are multiples of 25, so their limits may move by one step of a discrete
    # distribution: 25 divided by the number of runs.
    steps = 25 / len(case["x"]) if name != "probability_of_improvement" else 0.01
    near = 0.08 * (high - low) + steps
    assert [estimated.low, estimated.high] == pytest.approx([low, high], abs=near)


@pytest.mark.parametrize("case", CASES)
def test_performance_profiles_equal_rliable(case):
    profile = st.performance_profile(strata(case["x"]), np.array(_MADE["thresholds"]))
    np.testing.assert_allclose(profile, case["profile"], atol=1e-12)


def test_tasks_with_unequal_seeds_have_equal_weight():
    unequal = [np.array([0.0]), np.array([1.0, 1.0, 1.0])]
    assert st.performance_profile(unequal, np.array([0.5])).tolist() == [0.5]
    assert st.median(unequal) == 1.0  # of four runs: 0, 1, 1, 1
    # Four runs of weight 1/8 at 0, one of 1/4 at 100 and one at 200. A sixth is left out at each
    # end, so that 1/3, 1/4 and 1/12 are left: (25 + 200 / 12) / (2 / 3).
    weighted = [np.zeros(4), np.array([200.0, 100.0])]
    assert st.interquartile_mean(weighted) == pytest.approx(62.5)
    resampled = [np.zeros((3, 4)), np.tile([200.0, 100.0], (3, 1))]
    assert st.interquartile_mean(resampled) == pytest.approx([62.5] * 3)


@pytest.mark.filterwarnings("error")
def test_infinite_scores_that_are_left_out_count_nothing():
    # Of the weights, three of 1/8 are at 0, one of 1/4 at 100, one of 1/4 at 200, and one of 1/8 is
    # infinite. From 1/6 to 5/6 of them, 5/24 at 0, 6/24 at 100 and 5/24 at 200 are left.
    unequal = [np.array([0.0, np.inf, 0.0, 0.0]), np.array([200.0, 100.0])]
    assert st.interquartile_mean(unequal) == pytest.approx(100)
    # The quarter that is left out at the upper end is the infinite score.
    whole = [np.zeros(6), np.array([100.0, np.inf])]
    assert st.interquartile_mean(whole) == pytest.approx(50)
    # Both ends: -inf has 1/4 of the weights, of which 1/6 is left out.
    assert st.interquartile_mean([np.zeros(4), np.array([1.0, -np.inf])]) == -np.inf
    # As with equal numbers of seeds.
    assert st.interquartile_mean([np.array([1.0, 2.0, 3.0, np.inf])]) == 2.5


@pytest.mark.parametrize("seeds", [1, 2, 3, 5, 8, 10, 11, 40])
def test_medians_equal_numpy_bit_for_bit(seeds):
    scores = np.random.default_rng(seeds).normal(500, 100, size=(50, seeds))
    assert np.array_equal(st.median([scores]), np.median(scores, axis=1))


def test_standard_deviation_is_that_of_one_seed_less():
    # Of both tasks together, the mean is 3 and the squares add up to 4 + 0 + 4 + 0.
    assert st.standard_deviation([np.array([1.0, 3.0]), np.array([5.0, 3.0])]) == (8 / 3) ** 0.5
    assert np.isnan(st.standard_deviation([np.array([7.0])]))


def test_interval_of_profile_is_that_of_resampled_seeds():
    scores = [np.linspace(100, 900, 9)]
    thresholds = np.array([0.0, 450.0, 950.0])
    low, high = st.profile_interval(scores, thresholds, resamples=20_000)
    assert (low[0], high[0], low[2], high[2]) == (1, 1, 0, 0)
    # The number of 9 seeds above 450, of which 5 are, is binomial: 2 and 8 are its 2.5% ends.
    assert (low[1], high[1]) == pytest.approx((2 / 9, 8 / 9))


def test_probability_of_improvement_has_one_distribution_however_it_is_computed():
    random = np.random.default_rng(3)
    ours, theirs = (
        [random.integers(0, 9, n).astype(float) for n in sizes] for sizes in ((5, 7), (4, 6))
    )
    direct = st.probability_of_improvement

    def wrapped(first, second):
        return direct(first, second)

    by_counts, by_pairs = st.samples([direct, wrapped], ours, theirs, resamples=500)
    assert by_counts.value == by_pairs.value
    np.testing.assert_allclose(by_counts.drawn, by_pairs.drawn, rtol=1e-12)
    assert np.ptp(by_counts.drawn) > 0.1


def test_resamples_that_are_kept_are_those_that_were_drawn():
    """Of sizes that were asked for before, and of some whose resamples are no longer kept."""
    random = np.random.default_rng(5)

    def drawn(first, second):
        scores = [random.normal(size=first)], [random.normal(size=second)]
        (found,) = st.samples([st.difference(st.mean)], *scores, resamples=200)
        generator = np.random.default_rng(0)
        ours, theirs = (
            side[0][generator.integers(len(side[0]), size=(200, len(side[0])))].mean(axis=1)
            for side in scores
        )
        np.testing.assert_allclose(found.drawn, ours - theirs, rtol=1e-12, atol=1e-12)

    for sizes in [(4, 6), (4, 6), (6, 4), *((3, other) for other in range(3, 12)), (4, 6)]:
        drawn(*sizes)


def test_standard_error_is_the_deviation_of_resampled_seeds():
    # A resampled seed deviates from the mean by 5, the mean of four by 5 / sqrt(4). The deviation
    # of 10,000 resamples varies by 0.7% (one sd).
    estimated = st.estimate(mean, [np.array([0.0, 0.0, 10.0, 10.0])])
    assert estimated.standard_error == pytest.approx(2.5, rel=0.03)


def test_interval_is_reproducible_and_needs_three_seeds():
    seeds = [np.array([1.0, 2.0, 4.0, 8.0])]
    assert st.estimate(mean, seeds) == st.estimate(mean, seeds)
    two = st.estimate(mean, [np.array([1.0, 3.0])])
    assert two.value == 2.0
    assert np.isnan([two.low, two.high, two.standard_error]).all()


def test_seeds_that_never_reach_a_return_count_as_infinite():
    steps = np.array([20.0, 10.0, np.inf])
    assert st.median([steps]) == 20.0
    estimated = st.estimate(st.median, [steps])
    assert (estimated.low, estimated.high) == (10.0, np.inf)
    # Two of three seeds never reach it: the median is infinite.
    assert st.median([np.array([10.0, np.inf, np.inf])]) == np.inf


def test_resamples_without_a_value_do_not_narrow_an_interval():
    # The numbers 1 to 99, and one resample without any. At the lower end it comes before 1, so that
    # the sixth of all is 5. At the upper end it comes after 99, and the fifth from above is 96.
    some = st.Resampled(50.0, np.append(np.arange(1.0, 100.0), np.nan)).estimate(0.9)
    assert (some.low, some.high) == (5.0, 96.0)
    assert np.isnan(some.standard_error)

    # All of ours are equal. A third of the resamples, (5/6)^6, has equal ones of theirs as well, so
    # that their ratio is 0 to 0: nothing is known of it. Without them it would be 0, from 0 to 0.
    equal = np.full(6, 5.0)
    one_differs = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 10.0])
    ratio = st.estimate(st.ratio(st.standard_deviation), [equal], [one_differs])
    assert (ratio.value, ratio.low, ratio.high) == (0.0, -np.inf, np.inf)


def test_seeds_to_decide_match_hand_computed_values():
    # An effect of one standard error needs (1.96 + 0.8416)^2 = 7.85 times the seeds.
    assert seeds_to_decide(1.0, 1.0, 10) == 79
    assert seeds_to_decide(10.0, 1.0, 10) == st.MIN_SEEDS
    assert seeds_to_decide(0.0, 1.0, 10) is None
    # 10 * (2.8 / 1e-300) ** 2 overflows.
    assert seeds_to_decide(1e-300, 1.0, 10) is None
    assert seeds_to_decide(1.0, np.nan, 10) is None
