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

from jbench.array_types import FloatArray
from jbench.statistics.sequential import BLOCK, decided_at, interval
from jbench.statistics.verdicts import Verdict


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

    Where one analysis finds a direction and equality within the margin, it is the direction, unlike
    in `verdicts.Evidence.verdict`.

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


def sequential_decisions(
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
        blocks = min(len(ours) // BLOCK, len(theirs) // BLOCK, most)
        complete.append(blocks)
        cut.append((ours[: blocks * BLOCK], theirs[: blocks * BLOCK]))

    @cache
    def reached(i: int, verdict: Verdict, rate: float) -> int:
        return int(complete[i] and decided_at(verdict, *cut[i], margins[i], rate, analyses[i]))

    stops = step_down(reached, shares, max(analyses, default=0))
    decisions = []
    for i, parts in enumerate(_parts(stops, shares)):
        never = Stop("undecided", complete[i], 2 * sum(shares) / parts)
        decisions.append(_decision(stops[i] or never, *cut[i], analyses[i], margins[i]))

    return decisions


def _decision(
    stop: Stop, ours: FloatArray, theirs: FloatArray, analyses: int, margin: float
) -> Decision:
    """Returns a stop with the difference and its interval at that interim analysis."""
    seeds = stop.analysis * BLOCK
    difference = np.nan
    low = -np.inf
    high = np.inf
    if stop.analysis:
        first = ours[:seeds]
        second = theirs[:seeds]
        difference = float(first.mean() - second.mean())
        low, high = interval(first, second, stop.rate, analyses, margin)

    spent = stop.rate * stop.analysis / analyses
    return Decision(stop.verdict, seeds, difference, low, high, stop.rate, spent)
