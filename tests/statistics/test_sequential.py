"""Tests of the group-sequential test: hand-computed examples, scipy, and error rates."""

import numpy as np
import pytest
from scipy import stats

from jbench.statistics.sequential import decided_at, first_above, interval
from jbench.statistics.step_down import sequential_decisions

ANALYSES = 6  # at 5, 10 ... 30 seeds


def compare(ours, theirs, margin, rate, analyses):
    (decision,) = sequential_decisions([(ours, theirs)], [rate], [analyses], [margin])
    return decision


def normal(random, shape):
    return random.normal(500, 100, shape)


def skewed(random, shape):
    return 900 - random.exponential(150, shape)


def bounded(random, shape):
    """Returns in [0, 1000]: some seeds fail with 0, many reach the maximum, so there are ties."""
    return np.clip(random.normal(800, 400, shape), 0, 1000)


@pytest.mark.parametrize(
    ("ours", "theirs", "p"),
    [
        # For the six ways to choose ours from 9, 8, 2 and 1, the differences of the means are
        # 7 (9, 8), 1 (9, 2), 0 (9, 1), 0 (8, 2), -1 (8, 1) and -7 (2, 1).
        ([9, 8], [1, 2], 1 / 6),
        ([9, 2], [8, 1], 2 / 6),
        ([8, 2], [9, 1], 4 / 6),  # the tie counts as at least as large
        ([2, 1], [9, 8], 1),
        # Two blocks of these: 36 ways; only one has a sum of 14, only two more have 8.
        ([9, 8, 9, 8], [1, 2, 1, 2], 1 / 36),
        ([9, 8, 9, 2], [1, 2, 8, 1], 3 / 36),
    ],
)
def test_rejection_agrees_with_hand_computed_p_value(ours, theirs, p):
    ours, theirs = np.array(ours, float), np.array(theirs, float)
    blocks = len(ours) // 2

    def last_analysis_rejects(rate):
        # If earlier analyses reject no relabeling, the last one has the whole rate.
        return first_above(ours, theirs, rate, blocks, block=2) == blocks

    # With two blocks this is less than 2 / 6: the first analysis may reject none.
    assert last_analysis_rejects(p + 0.01) == (p < 1)
    assert not last_analysis_rejects(p - 0.01)


def test_error_rate_spent_by_earlier_analysis_is_not_available():
    # 2 analyses, rate 2/6: the first may reject one of six relabelings: 6 of the 36 of both
    # blocks; 12 are allowed up to the second, so 6 are left for it, of the 30 others. Their largest
    # sums are 8 (1 + 7), 7, 7 (0 + 7), 6 (-1 + 7), 2 (1 + 1), and then 1, four times.
    first, second = np.array([9.0, 2.0]), np.array([9.0, 8.0])
    theirs, bad = np.array([8.0, 1.0]), np.array([1.0, 2.0])
    rate = 2 / 6 + 1e-6

    def analysis(ours, other):
        return first_above(np.concatenate(ours), np.concatenate(other), rate, 2, block=2)

    assert analysis([second, first], [bad, theirs]) == 1
    assert analysis([first, second], [theirs, bad]) == 2  # 8
    assert analysis([first, first], [theirs, theirs]) == 2  # 2: the fifth
    nine_one, eight_two = np.array([9.0, 1.0]), np.array([8.0, 2.0])
    assert analysis([first, nine_one], [theirs, eight_two]) == 0  # 1: from the sixth to the ninth


def test_single_analysis_equals_permutation_test_of_scipy():
    random = np.random.default_rng(0)
    for _ in range(20):
        ours, theirs = random.normal(1.5, 1, 5), random.normal(0, 1, 5)
        compared = stats.permutation_test(
            (ours, theirs),
            lambda x, y, axis: x.mean(axis=axis) - y.mean(axis=axis),
            vectorized=True,
            n_resamples=np.inf,
            alternative="greater",
        )
        assert first_above(ours, theirs, compared.pvalue + 1e-6, 1) == (compared.pvalue < 1)
        assert first_above(ours, theirs, compared.pvalue - 1e-6, 1) == 0


@pytest.mark.parametrize(
    "distribution", [normal, *(pytest.param(d, marks=pytest.mark.slow) for d in (skewed, bounded))]
)
def test_false_positives_do_not_exceed_error_rate(distribution):
    random, repetitions = np.random.default_rng(1), 2000
    ours, theirs = (distribution(random, (repetitions, 5 * ANALYSES)) for _ in range(2))
    rate = 0.05
    above = [
        first_above(*pair, rate / 2, ANALYSES, relabelings=1000) > 0
        for pair in ((ours, theirs), (theirs, ours))
    ]
    wrong = np.mean(above[0] | above[1])
    # Three standard errors of the estimate are 0.015. A rate well below would waste seeds.
    error = 3 * np.sqrt(rate * (1 - rate) / repetitions)
    assert rate - 2 * error < wrong < rate + error


def test_larger_shift_is_detected_with_fewer_seeds():
    random = np.random.default_rng(2)
    theirs = normal(random, (200, 30))
    needed = []
    for shift in (150, 300):  # 1.5 and 3 standard deviations
        ours = normal(random, (200, 30)) + shift
        analyses = first_above(ours, theirs, 0.025, ANALYSES, relabelings=2000)
        assert np.mean(analyses > 0) > 0.97
        needed.append(5 * analyses.mean())
    # A test of one size with a power of 97% needs 2 ((1.96 + 1.88) / 1.5)^2 = 13.1 seeds.
    assert needed[0] < 14
    assert needed[1] < 7.5  # most need one block only


@pytest.mark.parametrize("difference", [50, -50])
def test_configurations_that_differ_by_margin_are_rarely_equal(difference):
    random, repetitions = np.random.default_rng(3), 500
    # The spread is small enough compared with the margin that equality can be found.
    ours, theirs = (random.normal(500, 25, (repetitions, 30)) for _ in range(2))
    analyses = decided_at("equal", ours + difference, theirs, 50, 0.05, ANALYSES, relabelings=1000)
    assert np.mean(analyses > 0) < 0.025 + 3 * np.sqrt(0.025 / repetitions)
    same = decided_at("equal", ours, theirs, 50, 0.05, ANALYSES, relabelings=1000)
    assert np.mean(same > 0) > 0.9


def test_result_is_independent_of_seed_order_in_block():
    random = np.random.default_rng(4)
    ours, theirs = normal(random, 30) + 60, normal(random, 30)
    expected = compare(ours, theirs, 50, 0.05, ANALYSES)
    for _ in range(3):
        shuffled = [random.permuted(x.reshape(6, 5), axis=1).ravel() for x in (ours, theirs)]
        compared = compare(*shuffled, 50, 0.05, ANALYSES)
        assert compared.verdict == expected.verdict
        assert compared[1:] == pytest.approx(expected[1:])


def test_decision_agrees_with_interval_and_is_final():
    random = np.random.default_rng(5)
    verdicts = set()
    for shift, spread in ((200, 100), (-200, 100), (0, 15), (20, 100), (30, 5)):
        ours, theirs = random.normal(shift, spread, 30), random.normal(0, spread, 30)
        compared = compare(ours, theirs, 50, 0.05, ANALYSES)
        outside = compared.low > 0 or compared.high < 0
        within = compared.low > -50 and compared.high < 50
        assert (compared.verdict in ("larger", "smaller")) == outside
        assert (compared.verdict == "equal") == (within and not outside)
        assert compared.low < compared.difference < compared.high
        assert compared.spent == pytest.approx(0.05 * compared.seeds / 30)
        # Additional seeds change nothing; fewer seeds are undecided.
        assert compare(ours[: compared.seeds], theirs, 50, 0.05, ANALYSES) == compared
        fewer = compare(ours[: compared.seeds - 1], theirs, 50, 0.05, ANALYSES)
        assert fewer.verdict == "undecided"
        verdicts.add(compared.verdict)
    assert verdicts == {"larger", "smaller", "equal", "undecided"}


@pytest.mark.parametrize("difference", [0.0, 200.0])
def test_interval_of_seeds_without_spread_is_their_difference(difference):
    """Rounding counts as a tie, which must not make the interval unbounded."""
    compared = compare(np.full(5, 500 + difference), np.full(5, 500.0), 50, 0.05, ANALYSES)
    assert compared.verdict == ("larger" if difference else "equal")
    assert (compared.low, compared.high) == pytest.approx((difference, difference), abs=1e-4)
    assert compared.low <= difference <= compared.high


@pytest.mark.parametrize("beyond", [1e-5, 0.0, -1e-5])
@pytest.mark.parametrize("limit", [0, -50])
@pytest.mark.parametrize("are_swapped", [False, True])
def test_end_of_interval_is_on_the_side_of_the_verdict(beyond, limit, are_swapped):
    # Of the 252 relabelings of five seeds each, one may be rejected on each side: the observed one
    # if all of ours, less the shift, are above all of theirs. So the interval begins at the
    # difference of the smallest of ours and the largest of theirs.
    ours = np.array([500.0, 510, 520, 530, 540])
    theirs = np.array([480.0, 485, 490, 495, 500]) - limit - beyond
    end = limit + beyond
    if are_swapped:
        ours, theirs = theirs, ours
    compared = compare(ours, theirs, 50, 2 / 252 + 1e-6, 1)
    low = -compared.high if are_swapped else compared.low

    assert low == pytest.approx(end, abs=0.01)
    assert (low > limit) == (beyond > 0)
    assert (low == limit) == (beyond == 0)
    decided = "equal" if limit else "smaller" if are_swapped else "larger"
    assert compared.verdict == (decided if beyond > 0 else "undecided")


def test_seeds_beyond_the_planned_analyses_count_nothing():
    # Of the only block that is planned, both sides have the same seeds.
    theirs = np.arange(10.0)
    ours = np.where(theirs < 5, theirs, 1000 + theirs)
    compared = compare(ours, theirs, 0, 0.05, 1)
    assert (compared.verdict, compared.seeds, compared.difference) == ("undecided", 5, 0)
    assert compare(ours, theirs, 0, 0.05, 2).seeds == 10


def test_five_seeds_are_undecided_with_shared_error_rate():
    # The smallest p-value of 5 + 5 seeds is 1/252.
    ours, theirs = np.arange(10.0) + 1000, np.arange(10.0)
    compared = compare(ours[:5], theirs[:5], 50, 0.05 / 16, ANALYSES)
    assert (compared.verdict, compared.seeds) == ("undecided", 5)
    assert (compared.low, compared.high) == (-np.inf, np.inf)
    assert compare(ours, theirs, 50, 0.05 / 16, ANALYSES).verdict == "larger"
    assert interval(ours, theirs, 0.05 / 16, ANALYSES)[0] > 900
    assert compare(ours[:4], theirs, 50, 0.05, ANALYSES)[:2] == ("undecided", 0)
