"""Comparisons of configurations by a number, and their verdicts in words.

`statistics.verdicts` has the rule for verdicts, and corrects their level for a family of
comparisons. Comparisons that a study plans have the verdict of its sequential test instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jbench.numbers import decimals, end, fixed, signed, whole
from jbench.statistics.verdicts import DECIDING_SEEDS, Evidence, corrected_verdicts
from jbench.studies.quantities import FINAL_RETURN, SIMILAR, UNDECIDED, Quantity
from jbench.wording import joined_clauses

SEQUENTIAL = "sequential test"
"""Origin of the verdicts of the group-sequential test."""

_TOO_FEW = f"fewer than {DECIDING_SEEDS} seeds"

_MARKS = {
    "higher": "✓",
    "less variable": "✓",
    "faster": "✓",
    "lower": "✗",
    "more variable": "✗",
    "slower": "✗",
    SIMILAR: "=",
    UNDECIDED: "?",
}
"""A check mark speaks for the first of two configurations."""


@dataclass(frozen=True)
class Judgment:
    """The verdict on a comparison, and the corrected interval on which it rests.

    Attributes:
        word: one of the words of a quantity.
        low, high: ends of the interval.
        by: what the interval is corrected by; empty if there is one comparison only.
    """

    word: str
    low: float
    high: float
    by: str


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two configurations that are compared by a number, the first minus the second.

    Attributes:
        quantity: the number that is compared.
        names: columns that name what is compared.
        evidence: what the seeds say about the difference.
        remark: a clause on how the sides were evaluated; empty if both were alike.
        unknown: a clause on why the number is unknown; empty if it is known, or the remark says it.
    """

    quantity: Quantity
    names: Mapping[str, Any]
    evidence: Evidence
    remark: str = ""
    unknown: str = ""

    def row(self, judgment: Judgment) -> dict[str, Any]:
        """Returns the names, the number and the verdict, by columns of a frame."""
        value, low, high, _ = self.evidence.estimate(0.95)
        return {
            **self.names,
            "claim": self.quantity.claim,
            "value": value,
            "low": low,
            "high": high,
            "verdict": judgment.word,
            "mark": _MARKS[judgment.word],
            "corrected_low": judgment.low,
            "corrected_high": judgment.high,
            "corrected_by": judgment.by,
            "text": joined_clauses(self._text(judgment, value), self.remark),
            "remark": self.remark,
        }

    def _text(self, judgment: Judgment, value: float) -> str:
        """Returns a verdict in words, with the difference that it rests on."""
        text = self._number(judgment, value)
        word = judgment.word
        low = judgment.low
        high = judgment.high
        is_tested = judgment.by not in (SEQUENTIAL, _TOO_FEW)
        if word == UNDECIDED and is_tested and (low > 0 or high < 0):
            p_value = self.evidence.p_value(0.0)
            return f"{word}: {text}; p = {p_value:.2g}, too large for a verdict"

        if self.quantity is not FINAL_RETURN or word not in FINAL_RETURN.directions:
            return f"{word}: {text}"

        margin = self.evidence.margin
        if margin and np.isfinite([low, high]).any():
            beyond = "yes" if min(abs(low), abs(high)) > margin else UNDECIDED
            return f"{text}; by more than {margin:g}: {beyond}"

        return text

    def _number(self, judgment: Judgment, value: float) -> str:
        """Returns the difference in words, or why its interval decides nothing."""
        if np.isnan(value):
            return ", ".join(filter(None, ("unknown", self.unknown)))

        low = judgment.low
        high = judgment.high
        if judgment.by == _TOO_FEW or not np.isfinite([low, high]).any():
            reason = "the sequential test needs more" if judgment.by == SEQUENTIAL else "too few"
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


def judge(family: Sequence[Comparison]) -> list[Judgment]:
    """Judges comparisons by the same quantity, each corrected for the others."""
    verdicts, level = corrected_verdicts([comparison.evidence for comparison in family])
    count = sum(comparison.evidence.is_decidable for comparison in family)
    corrected_by = f"Holm, {count} comparisons" if count > 1 else ""

    judgments = []
    for comparison, verdict in zip(family, verdicts, strict=True):
        evidence = comparison.evidence
        word = comparison.quantity.word(verdict)
        _, low, high, _ = evidence.estimate(1 - level)
        by = corrected_by if evidence.is_decidable else _TOO_FEW
        judgments.append(Judgment(word, low, high, by))

    return judgments
