"""Holm's step-down procedure for group-sequential comparisons that share an error rate.

A comparison that is decided passes its share of the error rate on to the others (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979). With group-sequential
tests this holds at the same and at later interim analyses, with earlier ones included (W. Maurer,
F. Bretz, *Multiple testing in group sequential trials using graphical approaches*, Stat. Biopharm.
Res. 5, 2013; Y. Ye, A. Li, L. Liu, B. Yao, *A group sequential Holm procedure with multiple primary
endpoints*, Stat. Med. 32, 2013).
"""

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from jbench.statistics import FloatArray
from jbench.statistics.sequential import BLOCK, ERROR_RATE, Verdict, decided_at, interval


class Decision(NamedTuple):
    """Outcome of a comparison at the deciding interim analysis, or at the last one so far."""

    verdict: Verdict  # ours is larger or smaller than theirs, equal within the margin, or undecided
    seeds: int  # of each configuration at that analysis; 0 before the first block is complete
    difference: float  # of the means, ours minus theirs; NaN without seeds
    low: float  # of the repeated confidence interval at `rate`; -inf if it is unbounded
    high: float
    rate: float  # two-sided error rate at which it was decided, or is tested now
    spent: float  # part of this rate spent up to that analysis


class Stop(NamedTuple):
    """The interim analysis, from 1 on, and the two-sided rate at which a comparison was decided."""

    verdict: Verdict
    analysis: int
    rate: float


Interval = Callable[[float], tuple[float, float]]
"""Gives the ends of a number's interval at a confidence."""

HasDirection = Callable[[float], bool]
"""Tells whether the interval at a confidence decides which side of a comparison is larger."""

Reached = Callable[[int, Verdict, float], int]
"""Interim analysis at which a comparison (its index) has a verdict at a two-sided rate; else 0."""


def step_down(reached: Reached, shares: Sequence[float], analyses: int) -> list[Stop | None]:
    """Decides comparisons together, at an error rate of at most the sum of their shares.

    Each comparison consists of two one-sided hypotheses (not larger, not smaller) with half of its
    share each. A decision that one configuration is larger or smaller rejects one of them, whose
    share then goes to the undecided comparisons in proportion to theirs, at the same interim
    analysis and at later ones. The other hypothesis and those of comparisons that are equal within
    the margin may be true, so they keep theirs. So a wrong decision, a wrong direction and a wrong
    equality included, rejects a true hypothesis, and is the first to do so at a rate that is no
    larger than its share among the true hypotheses alone (Holm, 1979; Maurer and Bretz, 2013).

    This needs tests that reject at every rate above one at which they reject. A permutation test,
    whose rates are whole numbers of relabelings, can fail to, so rates are limited to the sum of
    the shares over whole numbers, and a verdict has to be reached at all larger ones, too.

    Returns a stop per comparison, from its share, a two-sided error rate; None if it is undecided.
    """
    total = sum(shares)
    stops: list[Stop | None] = [None] * len(shares)
    # Into how many parts the rate is divided if all other comparisons have a direction.
    fewest = [math.ceil(total / share + 1 - 1e-6) for share in shares]

    for analysis in range(1, analyses + 1):
        new = True
        while new:
            new = False
            for i, parts in enumerate(_parts(stops, shares)):
                if stops[i] is not None:
                    continue
                rates = [2 * total / n for n in range(parts, min(fewest[i], parts) - 1, -1)]
                verdict = _earliest_verdict(partial(reached, i), rates, analysis)
                if verdict is not None:
                    stops[i] = Stop(verdict, analysis, rates[0])
                    new = True

    return stops


def _earliest_verdict(
    reached: Callable[[Verdict, float], int], rates: Sequence[float], analysis: int
) -> Verdict | None:
    """Returns the first verdict that is reached at all rates up to an interim analysis.

    Args:
        reached: interim analysis at which a verdict is reached at a rate; else 0.
        rates: two-sided; the verdict that the first of them reaches earliest is returned.
        analysis: the last one that counts.
    """
    names: tuple[Verdict, ...] = ("larger", "smaller", "equal")
    robust = [name for name in names if all(0 < reached(name, rate) <= analysis for rate in rates)]
    return min(robust, key=lambda name: reached(name, rates[0]), default=None)


def _parts(stops: Sequence[Stop | None], shares: Sequence[float]) -> list[int]:
    """Returns into how many parts the error rate is divided, of which each side gets one."""
    directed = [stop is not None and stop.verdict != "equal" for stop in stops]
    left = sum(share * (2 - rejected) for share, rejected in zip(shares, directed, strict=True))
    return [math.ceil(left / share - 1e-6) for share in shares]


def decide(
    pairs: Sequence[tuple[FloatArray, FloatArray]],
    shares: Sequence[float],
    analyses: Sequence[int],
    margins: Sequence[float],
) -> list[Decision]:
    """Compares pairs of configurations, each pair up to the interim analysis that decides it.

    Only blocks that are complete in both configurations count.

    Args:
        pairs: (comparisons,) numbers of ours (seeds,) and theirs (seeds,), in the order of seeds.
        shares: (comparisons,) two-sided error rates, whose sum is that of all together.
        analyses: (comparisons,) planned interim analyses.
        margins: (comparisons,) differences within which both are equal; 0 if they never are.
    """
    complete = []
    cut = []
    for (ours, theirs), most in zip(pairs, analyses, strict=True):
        complete.append(min(len(ours) // BLOCK, len(theirs) // BLOCK, most))
        cut.append((ours[: complete[-1] * BLOCK], theirs[: complete[-1] * BLOCK]))

    @cache
    def reached(i: int, verdict: Verdict, rate: float) -> int:
        return int(complete[i] and decided_at(verdict, *cut[i], margins[i], rate, analyses[i]))

    stops = step_down(reached, shares, max(analyses, default=0))
    decisions = []
    for i, parts in enumerate(_parts(stops, shares)):
        never = Stop("undecided", complete[i], 2 * sum(shares) / parts)
        verdict, analysis, rate = stops[i] or never
        seeds = analysis * BLOCK
        ours, theirs = (side[:seeds] for side in cut[i])
        low, high = -np.inf, np.inf
        if analysis:
            low, high = interval(ours, theirs, rate, analyses[i], margins[i])
        difference = float(ours.mean() - theirs.mean()) if analysis else np.nan
        spent = rate * analysis / analyses[i]
        decisions.append(Decision(verdict, seeds, difference, low, high, rate, spent))

    return decisions


def corrected_level(family: Sequence[HasDirection]) -> float:
    """Returns the error rate of an interval in the last step of Holm's procedure.

    As in `step_down`, a comparison that is equal within the margin keeps its share: there may be no
    difference, which an interval at a larger rate could then exclude.
    """
    level = 1.0
    left = len(family)
    while left and (level == 1 or ERROR_RATE / left > level):
        level = ERROR_RATE / left
        left = sum(not has_direction(1 - level) for has_direction in family)
    return min(level, ERROR_RATE)
