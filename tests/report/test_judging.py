"""Tests of verdicts in words, on intervals and p-values that are given."""

import numpy as np
import pytest

from jbench.report.analysis.judging import SEQUENTIAL, Comparison, Judgment, judge
from jbench.statistics.bootstrap import Estimate
from jbench.statistics.verdicts import Evidence
from jbench.studies.quantities import FINAL_RETURN, SPEED, VARIABILITY


def compared(low, high, quantity=FINAL_RETURN, *, p=0.001, seeds=6, margin=50.0, remark=""):
    """A comparison with an interval at all confidences, and a p-value after all shifts."""
    estimate = Estimate((low + high) / 2, low, high)
    evidence = Evidence(lambda confidence: estimate, lambda shift: p, seeds, margin)
    return Comparison(quantity, {}, evidence, remark)


def judged(comparison):
    """Returns the row of a comparison that is judged alone."""
    (judgment,) = judge([comparison])
    return comparison.row(judgment)


@pytest.mark.parametrize(
    ("comparison", "mark", "text"),
    [
        (compared(60, 150), "✓", "higher by 60 to 150; by more than 50: yes"),
        (compared(12, 150), "✓", "higher by 12 to 150; by more than 50: undecided"),
        (compared(-150, -60), "✗", "lower by 60 to 150; by more than 50: yes"),
        (compared(-150, -12), "✗", "lower by 12 to 150; by more than 50: undecided"),
        (compared(12, 150, margin=0.0), "✓", "higher by 12 to 150"),
        (compared(0.002, 150), "✓", "higher by up to 150; by more than 50: undecided"),
        (compared(-10, 20), "=", "similar: -10 to +20"),
        (compared(-10, 60), "?", "undecided: -10 to +60"),
        (
            compared(12, 150, p=0.2),
            "?",
            "undecided: higher by 12 to 150; p = 0.2, too large for a verdict",
        ),
        (
            compared(-150, -12, p=0.2),
            "?",
            "undecided: lower by 12 to 150; p = 0.2, too large for a verdict",
        ),
        (compared(12, 150, seeds=5), "?", "undecided: +81, too few seeds"),
        (compared(np.nan, np.nan), "?", "undecided: unknown"),
        (
            compared(12, 150, SPEED, margin=0.0),
            "✓",
            "faster: mean return over the run higher by 12 to 150",
        ),
        (
            compared(-150, -12, SPEED, margin=0.0),
            "✗",
            "slower: mean return over the run lower by 12 to 150",
        ),
        (
            compared(12, 150, VARIABILITY, margin=0.0),
            "✗",
            "more variable: standard deviation between agents higher by 12 to 150",
        ),
        (
            compared(-150, -12, VARIABILITY, margin=0.0),
            "✓",
            "less variable: standard deviation between agents lower by 12 to 150",
        ),
        (compared(-10, 60, remark="at 20k"), "?", "undecided: -10 to +60; at 20k"),
    ],
)
def test_verdict_in_words(comparison, mark, text):
    row = judged(comparison)
    assert (row["mark"], row["text"]) == (mark, text)


def test_sequential_test_without_an_interval_needs_more_seeds():
    row = compared(12, 150).row(Judgment("undecided", -np.inf, np.inf, SEQUENTIAL))
    assert row["text"] == "undecided: +81, the sequential test needs more seeds"


def test_only_comparisons_with_enough_seeds_are_corrected_for():
    few = compared(12, 150, seeds=5)
    assert [judgment.by for judgment in judge([few, compared(12, 150)])] == [
        "fewer than 6 seeds",
        "",
    ]
    two = [compared(-10, 60), few, compared(-10, 60)]
    assert [judgment.by for judgment in judge(two)] == [
        "Holm, 2 comparisons",
        "fewer than 6 seeds",
        "Holm, 2 comparisons",
    ]


def test_interval_of_a_judgment_is_that_of_the_last_level():
    # The half width is 1 at a confidence of 95%, and 2 at one of 97.5%, that of two comparisons.
    widths = {0.95: 1.0, 0.975: 2.0}

    def estimate(confidence):
        half = widths[round(confidence, 9)]
        return Estimate(0.5, 0.5 - half, 0.5 + half)

    comparison = Comparison(FINAL_RETURN, {}, Evidence(estimate, lambda shift: 1.0, seeds=6))
    row = comparison.row(judge([comparison, comparison])[0])
    assert (row["low"], row["high"]) == (-0.5, 1.5)
    assert (row["corrected_low"], row["corrected_high"]) == (-1.5, 2.5)
    assert judge([comparison])[0].low == -0.5
