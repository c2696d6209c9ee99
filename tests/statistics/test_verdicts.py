"""Tests of the rule for verdicts, on intervals and p-values that were worked out by hand."""

from functools import partial

import numpy as np
import pytest
import scipy.stats

from jbench.statistics import bootstrap as st
from jbench.statistics.bootstrap import Estimate
from jbench.statistics.permutation import p_value
from jbench.statistics.verdicts import Evidence, corrected_verdicts


def evidence(low, high, p=0.0, seeds=6, **more):
    """Returns evidence with an interval at all confidences, and the p-value of all shifts."""
    estimate = Estimate((low + high) / 2, low, high)
    return Evidence(lambda confidence: estimate, lambda shift: p, seeds, **more)


@pytest.mark.parametrize(
    ("low", "high", "margin", "verdict"),
    [
        (1, 90, 0, "larger"),
        (-90, -1, 0, "smaller"),
        (-1, 90, 50, "undecided"),  # contains 0, and is not within the margin
        (0, 90, 50, "undecided"),  # an end at 0 does not exclude it
        (1, 90, 50, "larger"),
        (-49, 49, 50, "equal"),
        (1, 49, 50, "equal"),  # as is an interval within the margin that excludes 0
        (-50, 49, 50, "undecided"),  # an end at the margin is not within it
        (-1, 1, 0, "undecided"),  # without a margin, nothing is equal
        (np.nan, np.nan, 50, "undecided"),
        (-np.inf, np.inf, 50, "undecided"),
    ],
)
def test_interval_excludes_the_null_value_or_lies_within_the_margin(low, high, margin, verdict):
    assert evidence(low, high, margin=margin).verdict(0.05) == verdict


def test_null_value_of_a_probability_is_a_half():
    intervals = ((0.51, 1), (0.5, 1), (0, 0.49), (0.1, 0.9))
    found = [evidence(*interval, null_value=0.5).verdict(0.05) for interval in intervals]
    assert found == ["larger", "undecided", "smaller", "undecided"]


def test_equality_that_is_not_confirmed_leaves_the_direction():
    # Within the margin and above 0; that it is no 50 has a p-value of 0.3.
    near = Estimate(38, 28, 48)
    found = Evidence(lambda confidence: near, {0: 0.001, -50: 0.3, 50: 0.001}.get, 10, margin=50)
    assert found.verdict(0.05) == "larger"
    assert found.verdict(0.0009) == "undecided"


@pytest.mark.parametrize(("low", "high", "margin"), [(1, 90, 0), (-90, -1, 0), (-49, 49, 50)])
def test_permutation_test_confirms_a_verdict_at_the_same_level(low, high, margin):
    confirmed = evidence(low, high, p=0.01, margin=margin)
    assert confirmed.verdict(0.01) != "undecided"
    assert confirmed.verdict(0.0099) == "undecided"


def test_both_ends_of_the_margin_are_tested():
    p_values = {-50: 0.01, 50: 0.02}  # of the difference after -50 or 50 is added to the scores
    near = Estimate(10, -20, 40)
    equal = Evidence(lambda confidence: near, p_values.get, 6, margin=50)
    assert equal.verdict(0.02) == "equal"
    assert equal.verdict(0.019) == "undecided"


def test_fewer_than_six_seeds_decide_nothing():
    found = [evidence(1, 90, seeds=seeds).verdict(0.05) for seeds in (5, 6)]
    assert found == ["undecided", "larger"]


def test_interval_is_that_of_the_level():
    """The differences of a bootstrap are 0 to 1000: 0.1 of them are up to 100."""
    drawn = np.arange(1001.0) - 100
    larger = Evidence(st.Resampled(400.0, drawn).estimate, lambda shift: 0.0, 6)
    assert larger.verdict(0.21) == "larger"
    assert larger.verdict(0.19) == "undecided"


def test_six_seeds_that_are_all_larger_have_two_of_924_relabelings():
    ours = np.arange(6.0) + 10
    theirs = np.arange(6.0)
    sample = st.samples([st.difference(st.interquartile_mean)], [ours], [theirs])[0]
    found = Evidence(sample.estimate, partial(_p_value, ours, theirs), 6)
    assert found.verdict(2 / 924) == "larger"
    assert found.verdict(1.9 / 924) == "undecided"
    # So they decide nothing among 24 comparisons, but do among 23: 0.05 / 24 < 2 / 924.
    assert [found.verdict(0.05 / count) for count in (23, 24)] == ["larger", "undecided"]


def _p_value(ours, theirs, shift):
    return p_value([ours + shift], [theirs])


def final_level(family):
    return corrected_verdicts(family).level


def test_error_rate_is_divided_by_the_comparisons_that_are_left():
    # Comparisons that are decided at two-sided rates from 0.001, 0.02, 0.024 on, and never.
    family = [evidence(1, 2, p) for p in (0.001, 0.02, 0.024, 1)]
    # 0.05 / 4 decides the first, 0.05 / 3 none of the others.
    assert final_level(family) == pytest.approx(0.05 / 3)
    # 0.05 / 3 decides two of three, and 0.05 the last one.
    family = [evidence(1, 2, p) for p in (0.001, 0.016, 0.04)]
    assert final_level(family) == pytest.approx(0.05)
    assert final_level([]) == 0.05


def test_comparisons_without_enough_seeds_or_that_are_equal():
    """Those of few seeds take no part of the error rate, and equal ones pass none on."""
    few = evidence(1, 2, seeds=5)
    larger = evidence(1, 2)
    equal = evidence(-1, 1, margin=50)
    undecided = evidence(-1, 1)
    assert final_level([few, undecided, undecided]) == 0.05 / 2
    assert final_level([larger, undecided, undecided]) == 0.05 / 2
    assert final_level([few, larger, undecided, undecided]) == 0.05 / 2
    assert final_level([equal, undecided, undecided]) == 0.05 / 3


def test_a_direction_that_has_passed_its_share_on_stays():
    """Else a difference of 50 was equal in 2.5%, beside errors in 5% of the other comparison."""

    def normal(value, margin=0.0):  # of a standard error of 10
        def estimate(confidence):
            half = 10 * scipy.stats.norm.ppf((1 + confidence) / 2)
            return Estimate(value, value - half, value + half)

        def p_value(shift):
            return 2 * scipy.stats.norm.sf(abs(value + shift) / 10)

        return Evidence(estimate, p_value, seeds=6, margin=margin)

    # [7.6, 52.4] at 0.05 / 2, and [10.4, 49.6] at 0.05.
    near = normal(30, margin=50)
    assert [near.verdict(level) for level in (0.025, 0.05)] == ["larger", "equal"]
    assert corrected_verdicts([near]).verdicts == ["equal"]
    assert corrected_verdicts([near, normal(0)]).verdicts == ["larger", "undecided"]
