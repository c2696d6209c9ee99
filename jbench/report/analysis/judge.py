"""Verdicts on differences, each corrected for the others of its family.

A verdict rests on an interval at a level that Holm's step-down procedure gives (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): 5% over the number of
comparisons, then over the number of those that are left, and so on.
"""

from collections.abc import Callable, Sequence

import numpy as np

from jbench.report.analysis.claims import MARGIN, Row
from jbench.report.data.returns import signed, whole
from jbench.statistics import bootstrap as st
from jbench.statistics.sequential import ERROR_RATE

Interval = Callable[[float], tuple[float, float]]
"""Gives the ends of a number's interval at a confidence."""

SEQUENTIAL = "sequential test"  # origin of the verdicts of `--until-decided`
WORDS = {  # of a larger and of a smaller number
    "a": ("higher", "lower"),
    "b": ("more variable", "less variable"),
    "c": ("faster", "slower"),
}
_NUMBERS = {"a": "", "b": "standard deviation between agents ", "c": "mean return over the run "}
_MARKS = {
    **dict.fromkeys(("higher", "less variable", "faster"), "✓"),
    **dict.fromkeys(("lower", "more variable", "slower"), "✗"),
    **{"similar": "=", "undecided": "?"},
}  # a check mark speaks for the representation
_TOO_FEW = f"fewer than {st.DECIDING_SEEDS} seeds"


def judge(family: Sequence[Row], claim: str = "a", margin: float = MARGIN) -> None:
    """Adds to rows with the same claim the verdict on each, corrected for the others.

    A row has the value of a difference, its interval (an `Interval`), and whether there are enough
    seeds (decidable); differences within a margin are similar.
    """

    def decides(low: float, high: float) -> bool:
        return _word(low, high, "a", margin) != "undecided"

    intervals = [row["interval"] for row in family if row["decidable"]]
    level = corrected_level(intervals, decides)
    by = f"Holm, {len(intervals)} comparisons" if len(intervals) > 1 else ""
    for row in family:
        low, high = row["interval"](1 - level)
        verdict = _word(low, high, claim, margin) if row["decidable"] else "undecided"
        conclude(row, verdict, low, high, by if row["decidable"] else _TOO_FEW, claim, margin)


def conclude(
    row: Row, verdict: str, low: float, high: float, by: str, claim: str, margin: float
) -> None:
    """Adds a verdict, its mark and text to a row, and the corrected interval on which it rests."""
    text = f"{_NUMBERS[claim]}{_difference_text(low, high)}"
    if np.isnan(row["value"]):
        text = "unknown"
    elif by == _TOO_FEW or not np.isfinite([low, high]).any():
        reason = "the sequential test needs more" if by == SEQUENTIAL else "too few"
        text = f"{signed(row['value'])}, {reason} seeds"
    elif claim == "a" and verdict in WORDS["a"] and margin:
        beyond = "yes" if min(abs(low), abs(high)) > margin else "undecided"
        text += f"; by more than {margin:g}: {beyond}"
    if claim != "a" or verdict not in WORDS["a"]:
        text = f"{verdict}: {text}"
    row |= {"verdict": verdict, "mark": _MARKS[verdict], "text": text}
    row |= {"corrected_low": low, "corrected_high": high, "corrected_by": by}


def corrected_level(family: Sequence[Interval], decides: Callable[[float, float], bool]) -> float:
    """Returns the error rate of an interval in the last step of Holm's procedure."""
    level, left = 1.0, len(family)
    while left and (level == 1 or ERROR_RATE / left > level):
        level = ERROR_RATE / left
        left = sum(not decides(*interval(1 - level)) for interval in family)
    return min(level, ERROR_RATE)


def _word(low: float, high: float, claim: str, margin: float) -> str:
    if claim == "a" and low > -margin and high < margin:
        return "similar"
    above, below = WORDS[claim]
    return above if low > 0 else below if high < 0 else "undecided"


def _difference_text(low: float, high: float) -> str:
    """Formats an interval of a difference: `higher by 38 to 114`, `-20 to +35`."""
    if low > 0:
        return f"higher by {whole(low)} to {whole(high)}"
    if high < 0:
        return f"lower by {whole(-high)} to {whole(-low)}"
    return f"{signed(low)} to {signed(high)}" if np.isfinite([low, high]).any() else ""
