"""Verdicts on two configurations with a fixed number of seeds: one is larger, or they are equal.

`Evidence.verdict` is the rule of all comparisons of the report: an interval at a level has to
exclude the null value, or to lie within a margin, and a permutation test has to confirm it at the
same level, since bootstrap intervals of few seeds are too narrow at small levels.

`corrected_verdicts` judges comparisons that share an error rate, by Holm's step-down procedure
(S. Holm, *A simple sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): at
5% over the number of comparisons, then over the number of those in which neither configuration is
larger, and so on. It holds for the p-values, whatever the intervals are.

A comparison that is tested again after each block of seeds needs another rule, `step_down`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from jbench.statistics.bootstrap import Estimate

ERROR_RATE = 0.05
"""Probability of any wrong verdict, over all comparisons together, and over all analyses."""

DECIDING_SEEDS = 6
"""Minimum number of seeds for a verdict: the range of n seeds contains the population median with
probability 1 - 2^(1 - n), 94% for five, 97% for six."""

Verdict = Literal["larger", "smaller", "equal", "undecided"]
"""The first configuration is larger or smaller, both are equal within a margin, or neither."""

DIRECTIONS: tuple[Verdict, ...] = ("larger", "smaller")
"""The verdicts that tell which configuration is larger."""


@dataclass(frozen=True)
class Evidence:
    """What seeds say about a number that compares two configurations, such as a difference.

    Attributes:
        estimate: gives the number with its interval at a confidence.
        p_value: gives the two-sided p-value of the permutation test after a number is added to the
            scores of the first configuration.
        seeds: those of the configuration that has fewer.
        margin: configurations are equal if the number is nearer to the null value; 0 if none are.
        null_value: the number where neither configuration is larger: 0 of a difference.
    """

    estimate: Callable[[float], Estimate] = field(repr=False)
    p_value: Callable[[float], float] = field(repr=False)
    seeds: int
    margin: float = 0.0
    null_value: float = 0.0

    @property
    def is_decidable(self) -> bool:
        """Whether there are enough seeds for a verdict."""
        return self.seeds >= DECIDING_SEEDS

    def verdict(self, level: float) -> Verdict:
        """Returns the verdict at a two-sided level, such as 0.05.

        An interval that excludes the null value but lies within the margin is one of equality,
        unless the permutation test does not confirm that.
        """
        if not self.is_decidable:
            return "undecided"

        interval = self.estimate(1 - level)
        low = interval.low
        high = interval.high
        if low > self.null_value - self.margin and high < self.null_value + self.margin:
            # Two tests: that the number is at or beyond the one end of the margin, or the other.
            p_of_equality = max(self.p_value(-self.margin), self.p_value(self.margin))
            if p_of_equality <= level:
                return "equal"

        if np.isnan(low) or low <= self.null_value <= high or self.p_value(0.0) > level:
            return "undecided"

        return "larger" if low > self.null_value else "smaller"


class Corrected(NamedTuple):
    """The outcome of Holm's procedure.

    Attributes:
        verdicts: on each comparison of the family.
        level: that of the last step; `ERROR_RATE` if no comparison is decidable.
    """

    verdicts: list[Verdict]
    level: float


def corrected_verdicts(family: Sequence[Evidence]) -> Corrected:
    """Returns the verdicts of Holm's procedure on comparisons, and the level of its last step.

    As in `step_down`, a comparison that is equal within the margin keeps its share: there may be no
    difference, which an interval at a larger level could then exclude. One with a direction has
    passed its share on, so it keeps this verdict if at a larger level it would be equal.
    """
    verdicts: list[Verdict] = ["undecided"] * len(family)
    level = 0.0
    left = sum(evidence.is_decidable for evidence in family)
    while left and ERROR_RATE / left > level:
        level = ERROR_RATE / left
        verdicts = [
            verdict if verdict in DIRECTIONS else evidence.verdict(level)
            for verdict, evidence in zip(verdicts, family, strict=True)
        ]
        left = sum(
            evidence.is_decidable and verdict not in DIRECTIONS
            for verdict, evidence in zip(verdicts, family, strict=True)
        )

    return Corrected(verdicts, level or ERROR_RATE)
