"""Tests of the step-down procedure: hand-computed rates, and the error rate of many comparisons."""

import numpy as np
import pytest

from jbench.statistics.sequential import first_above
from jbench.statistics.step_down import sequential_decisions, step_down


def stepping(needed, verdict="larger"):
    """Returns tests that find a verdict at analysis 1 from the rate that a comparison needs."""

    def reached(i, name, rate):
        return int(name == verdict and rate >= needed[i] - 1e-9)

    return reached


def test_direction_passes_half_of_a_share_to_the_others():
    # Six one-sided hypotheses have 0.06 / 6 each, so each comparison is tested at 0.02. With one
    # decided, five are left: 0.024; then four: 0.03.
    shares = [0.02, 0.02, 0.02]
    steps = step_down(stepping([0.03, 0.02, 0.024]), shares, 1)
    assert [round(stop.rate, 9) for stop in steps] == [0.03, 0.02, 0.024]
    assert step_down(stepping([0.031, 0.02, 0.024]), shares, 1)[0] is None
    assert step_down(stepping([0.02, 0.0201, 0.0201]), shares, 1)[1:] != [None, None]
    # Bonferroni's rates are not exceeded before there is a decision.
    assert step_down(stepping([0.0201] * 3), shares, 1) == [None] * 3


def test_equality_passes_nothing_on():
    shares = [0.02, 0.02]
    assert step_down(stepping([0.02, 0.021], "equal"), shares, 1)[1] is None
    assert step_down(stepping([0.02, 0.021]), shares, 1)[1] is not None


def test_share_is_passed_on_in_proportion_to_shares():
    # Sides of 0.005 and 0.02: 10 and 2.5 parts of 0.05, of which 3 are used. After the first is
    # decided, its other side remains: 0.045 / 0.04 = 1.125 to 2.25 -> 3 parts, nothing gained.
    steps = step_down(stepping([0.01, 0.034]), [0.01, 0.04], 1)
    assert steps[0].rate == pytest.approx(0.01)
    assert steps[1] is None
    # After the second: 0.02 + 0.04 over 0.01: 6 parts, so 0.1 / 6 instead of 0.01.
    steps = step_down(stepping([0.0166, 0.03]), [0.01, 0.04], 1)
    assert [stop.rate for stop in steps] == pytest.approx([0.1 / 6, 0.1 / 3])


def test_verdict_must_hold_at_all_larger_rates():
    def reached(i, name, rate):  # found at 0.05 / 2, but not at 0.1 / 3
        return int(name == "larger" and (i == 1 or rate < 0.03))

    assert step_down(reached, [0.025, 0.025], 1)[0] is None


def test_later_analysis_decides_after_share_is_passed_on():
    def reached(i, name, rate):
        return {0: 3, 1: 1 if rate > 0.026 else 0}[i] if name == "larger" else 0

    first, second = step_down(reached, [0.025, 0.025], 4)
    assert (first.analysis, second.analysis) == (3, 3)
    assert second.rate == pytest.approx(0.1 / 3)


def test_decisions_of_bonferroni_remain_and_others_are_added():
    random = np.random.default_rng(0)
    theirs = random.normal(0, 100, 10)
    pairs = [(random.normal(shift, 100, 10), theirs) for shift in (400, 106, 0)]
    shares = [0.05 / 3] * 3
    together = sequential_decisions(pairs, shares, [2] * 3, [0] * 3)
    alone = [sequential_decisions([pair], shares[:1], [2], [0])[0] for pair in pairs]
    assert [decision.verdict for decision in alone] == ["larger", "undecided", "undecided"]
    assert [decision.verdict for decision in together] == ["larger", "larger", "undecided"]
    # One, then two of six one-sided hypotheses are rejected.
    assert [decision.rate for decision in together] == pytest.approx([0.1 / 6, 0.1 / 5, 0.1 / 4])
    assert together[1].low > 0 > alone[1].low


def test_error_rate_of_correlated_comparisons():
    # Three of six comparisons with the same baseline have no difference; the others pass on.
    random, repetitions, analyses, m = np.random.default_rng(1), 400, 2, 6
    theirs = np.tile(random.normal(0, 1, (repetitions, 10)), (m, 1, 1))
    shifts = np.array([4, 4, 4, 0, 0, 0])
    ours = random.normal(shifts[:, None, None], 1, theirs.shape)
    at = {
        (name, parts): first_above(
            sign * ours, sign * theirs, 0.05 / parts, analyses, relabelings=500
        )
        for parts in range(m + 1, 2 * m + 1)
        for name, sign in (("larger", 1), ("smaller", -1))
    }
    wrong = right = 0
    for r in range(repetitions):

        def reached(i, name, rate, r=r):
            return 0 if name == "equal" else int(at[name, round(0.1 / rate)][i, r])

        steps = step_down(reached, [0.05 / m] * m, analyses)
        wrong += any(stop is not None for stop in steps[3:])
        right += all(stop is not None for stop in steps[:3])
    assert wrong / repetitions <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / repetitions)
    assert right / repetitions > 0.9
