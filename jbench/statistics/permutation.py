"""Permutation tests of the difference between two configurations.

If two configurations have the same distribution of returns, every way to divide their seeds between
them (a relabeling) is equally likely, whatever the distribution is (E. J. G. Pitman, *Significance
tests which may be applied to samples from any populations*, J. R. Statist. Soc. Suppl. 4, 1937). So
the share of relabelings with a difference at least as large as the observed one is a p-value that
holds for few seeds, for which a bootstrap interval of a high confidence is too narrow.
"""

import math
from functools import lru_cache
from itertools import combinations

import numpy as np

from jbench.array_types import FloatArray, IntArray
from jbench.statistics import ROUNDING
from jbench.statistics.bootstrap import Strata

RELABELINGS_OF_TEN_SEEDS = 184_756
"""Relabelings of a test: all of two times ten seeds; of more seeds, a random sample."""


def p_value(ours: Strata, theirs: Strata, confirmed: float = 0.0) -> float:
    """Returns the two-sided p-value of a difference of means; 1 if a score is not finite.

    It is also 1 if the difference of means has another sign than the number that it should confirm:
    with many failed seeds, a configuration has the lower mean, but the higher interquartile mean.

    The statistic is that of the sequential test. With two times six seeds, the interquartile mean
    would tell fewer relabelings apart. On several tasks, the differences are averaged. On one task,
    all relabelings are used if there are at most `RELABELINGS_OF_TEN_SEEDS`; else a fixed random
    sample of this size, and the observed division.

    Args:
        ours, theirs: scores (seeds,) by task. Seeds are exchanged within a task only.
        confirmed: a number that compares the same scores, ours minus theirs; 0 if none does.
    """
    scores = np.concatenate([*ours, *theirs])
    if not np.isfinite(scores).all():
        return 1.0

    observed = sum(x.mean() - y.mean() for x, y in zip(ours, theirs, strict=True))
    if observed * confirmed < 0:
        return 1.0

    least = abs(observed) - ROUNDING * np.abs(scores).max()
    if len(ours) == 1 and math.comb(len(scores), len(ours[0])) <= RELABELINGS_OF_TEN_SEEDS:
        # Of all relabelings, the order of the scores does not matter.
        relabeled = _all_relabeled(tuple(np.sort(scores).tolist()), len(ours[0]))
        return float((np.abs(relabeled) >= least).mean())

    relabeled = np.zeros(1)
    for task, (x, y) in enumerate(zip(ours, theirs, strict=True)):
        chosen = _chosen(len(x), len(y), task)
        relabeled = relabeled + _differences(np.concatenate([x, y]), chosen)

    as_large = np.abs(relabeled) >= least
    return float((1 + as_large.sum()) / (1 + len(as_large)))


@lru_cache(maxsize=16)
def _all_relabeled(scores: tuple[float, ...], ours: int) -> FloatArray:
    """Returns the difference of means of each relabeling, of which the first side has some seeds.

    Ranks are the same in most comparisons of equally many seeds.
    """
    return _differences(np.array(scores), _chosen(ours, len(scores) - ours, None))


def _differences(scores: FloatArray, chosen: IntArray) -> FloatArray:
    """Returns the difference of means of each relabeling.

    Args:
        scores: (seeds,) of both sides.
        chosen: (relabelings, ours) places of the scores of the first side.
    """
    count = chosen.shape[1]
    means = scores[chosen].mean(axis=1)
    # Of all seeds, the others have what is left of the sum.
    others = (scores.sum() - count * means) / (len(scores) - count)
    return np.asarray(means - others)


@lru_cache(maxsize=16)
def _chosen(ours: int, theirs: int, seed: int | None) -> IntArray:
    """Returns which seeds are ours (relabelings, ours) of these numbers of seeds.

    Args:
        seed: of a random sample of relabelings; None for all of them.
    """
    seeds = np.arange(ours + theirs, dtype=np.int16)  # small, since all relabelings are kept
    if seed is None:
        return np.array([*combinations(seeds, ours)])

    random = np.random.default_rng(seed)
    order = random.permuted(np.tile(seeds, (RELABELINGS_OF_TEN_SEEDS, 1)), axis=1)
    return order[:, :ours].copy()
