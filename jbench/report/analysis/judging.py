"""Comparisons of configurations by a number, and verdicts that are corrected for their family.

A verdict rests on an interval at a level that Holm's step-down procedure gives (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): 5% over the number of
comparisons, then over the number of those in which neither number is larger, and so on. At these
levels, bootstrap intervals of few seeds are too narrow. So a permutation test has to confirm the
verdict at the same level; the procedure holds for its p-values, whatever the intervals are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jbench.report.numbers import decimals, end, fixed, signed, whole
from jbench.statistics import bootstrap as st
from jbench.statistics.step_down import Interval, corrected_level
from jbench.studies.quantities import FINAL_RETURN, Quantity

SEQUENTIAL = "sequential test"
"""Origin of the verdicts of the group-sequential test."""

PValue = Callable[[float], float]
"""Gives the p-value of a difference after a number is added to the scores of the first side."""

_UNDECIDED = "undecided"
_SIMILAR = "similar"

_TOO_FEW = f"fewer than {st.DECIDING_SEEDS} seeds"

_MARKS = {
    "higher": "✓",
    "less variable": "✓",
    "faster": "✓",
    "lower": "✗",
    "more variable": "✗",
    "slower": "✗",
    _SIMILAR: "=",
    _UNDECIDED: "?",
}
"""A check mark speaks for the first of two configurations."""


@dataclass(frozen=True)
class Judgment:
    """What is said about a comparison, and the corrected interval on which that rests.

    Attributes:
        word: one of the words of a quantity, similar, or undecided.
        low, high: ends of the interval.
        by: what the interval is corrected by; empty if there is one comparison only.
        text: a sentence for readers.
    """

    word: str
    low: float
    high: float
    by: str
    text: str


@dataclass
class Comparison:
    """Two configurations that are compared by a number, the first minus the second.

    Attributes:
        quantity: the number that is compared.
        names: columns that name what is compared.
        estimate: the number with its 95% interval.
        interval: the ends of its interval by confidence.
        p_value: of the permutation test.
        decidable: whether there are enough seeds for a verdict.
        margin: final returns that differ by less are similar; 0 if none are.
        judgment: None until it is judged.
    """

    quantity: Quantity
    names: Mapping[str, Any]
    estimate: st.Estimate
    interval: Interval = field(repr=False)
    p_value: PValue = field(repr=False)
    decidable: bool
    margin: float
    judgment: Judgment | None = None

    def conclude(self, word: str, low: float, high: float, by: str) -> None:
        """Records a verdict, the corrected interval on which it rests, and what corrects it."""
        self.judgment = Judgment(word, low, high, by, self._text(word, low, high, by))

    def row(self) -> dict[str, Any]:
        """Returns the names, the number and the verdict, by columns of a frame."""
        judgment = self.judgment
        assert judgment is not None
        return {
            **self.names,
            "claim": self.quantity.claim,
            "value": self.estimate.value,
            "low": self.estimate.low,
            "high": self.estimate.high,
            "verdict": judgment.word,
            "mark": _MARKS[judgment.word],
            "corrected_low": judgment.low,
            "corrected_high": judgment.high,
            "corrected_by": judgment.by,
            "text": judgment.text,
        }

    def word(self, confidence: float) -> str:
        """Returns the verdict of the interval at a confidence, if the permutation test agrees."""
        low, high = self.interval(confidence)
        level = 1 - confidence
        if self.quantity is FINAL_RETURN and low > -self.margin and high < self.margin:
            return _SIMILAR if self._p_of_similarity() <= level else _UNDECIDED
        if low <= 0 <= high or np.isnan(low) or self.p_value(0.0) > level:
            return _UNDECIDED
        return self.quantity.larger if low > 0 else self.quantity.smaller

    def _p_of_similarity(self) -> float:
        """Returns the larger p-value of two tests: that the difference is beyond the margin."""
        return max(self.p_value(shift) for shift in (-self.margin, self.margin))

    def has_direction(self, confidence: float) -> bool:
        """Returns whether the verdict at a confidence tells which number is larger."""
        return self.word(confidence) in self.quantity.directions

    def _text(self, word: str, low: float, high: float, by: str) -> str:
        """Returns a verdict in words, with the difference that it rests on."""
        text = self._number(low, high, by)
        if word == _UNDECIDED and by not in (SEQUENTIAL, _TOO_FEW) and (low > 0 or high < 0):
            return f"{word}: {text}; p = {self.p_value(0.0):.2g}, too large for a verdict"
        if self.quantity is not FINAL_RETURN or word not in FINAL_RETURN.directions:
            return f"{word}: {text}"
        if self.margin and np.isfinite([low, high]).any():
            beyond = "yes" if min(abs(low), abs(high)) > self.margin else "undecided"
            return f"{text}; by more than {self.margin:g}: {beyond}"
        return text

    def _number(self, low: float, high: float, by: str) -> str:
        """Returns the difference in words, or why its interval decides nothing."""
        value = self.estimate.value
        if np.isnan(value):
            return "unknown"
        if by == _TOO_FEW or not np.isfinite([low, high]).any():
            reason = "the sequential test needs more" if by == SEQUENTIAL else "too few"
            return f"{signed(value)}, {reason} seeds"

        if low > 0:
            text = f"higher by {_range(low, high)}"
        elif high < 0:
            text = f"lower by {_range(-high, -low)}"
        else:
            places = decimals(signed, (low, high))
            text = f"{end(low, places, '+')} to {end(high, places, '+')}"

        return f"{self.quantity.number} {text}".lstrip()


def _range(least: float, most: float) -> str:
    """Returns the range of the size of a difference in words, such as `10 to 156`."""
    places = decimals(whole, (least, most))
    shown = fixed(least, places)
    largest = fixed(most, places)
    return f"{shown} to {largest}" if shown.strip("0.") else f"up to {largest}"


def judge(family: Sequence[Comparison]) -> None:
    """Judges comparisons by the same quantity, each corrected for the others."""
    decidable = [comparison for comparison in family if comparison.decidable]
    level = corrected_level([comparison.has_direction for comparison in decidable])
    by = f"Holm, {len(decidable)} comparisons" if len(decidable) > 1 else ""
    for comparison in family:
        low, high = comparison.interval(1 - level)
        if comparison.decidable:
            comparison.conclude(comparison.word(1 - level), low, high, by)
        else:
            comparison.conclude(_UNDECIDED, low, high, _TOO_FEW)
