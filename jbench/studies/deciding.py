"""How comparisons are decided: by the first seeds of both sides, in blocks of five.

Interim analyses are at 5, 10, 15 ... seeds from seed 0. They depend only on the finished runs, so
no other state is stored, and whoever reads the same runs reaches the same decisions.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jbench.array_types import FloatArray
from jbench.names import ReturnsName
from jbench.returns import final_return, mean_over_run
from jbench.statistics.sequential import BLOCK
from jbench.statistics.step_down import Decision, sequential_decisions
from jbench.studies.entries import Claim
from jbench.studies.quantities import SPEED
from jbench.studies.study import PlannedComparison

Returns = Mapping[int, float | None]
"""Returns of finished runs by seed; None if a run has no finite return."""


def compared_return(points: FloatArray, kind: ReturnsName, claim: Claim) -> float | None:
    """Returns the number of a run that a claim compares; None if none of its points is finite.

    Args:
        points: (points,) returns of the run's training episodes, or means of its evaluations.
        kind: which of these they are.
        claim: on the final return, or on speed.
    """
    return mean_over_run(points) if claim == SPEED.claim else final_return(points, kind)


def decide(
    comparisons: Sequence[PlannedComparison], returns: Sequence[tuple[Returns, Returns]]
) -> list[Decision]:
    """Decides comparisons together, each by the seeds 0, 1, … that both sides have.

    A side has the seeds up to the first one that is not finished, or has no finite return: leaving
    it out would favor the side whose runs fail.

    Args:
        comparisons: those of one study, which share its error rate.
        returns: (comparisons,) of the first and the second side.
    """
    pairs = [
        (_first_seeds(first, comparison.max_seeds), _first_seeds(second, comparison.max_seeds))
        for comparison, (first, second) in zip(comparisons, returns, strict=True)
    ]
    shares = [comparison.share for comparison in comparisons]
    analyses = [comparison.max_seeds // BLOCK for comparison in comparisons]
    margins = [comparison.margin for comparison in comparisons]
    return sequential_decisions(pairs, shares, analyses, margins)


def _first_seeds(returns: Returns, most: int) -> FloatArray:
    """Returns the returns of the seeds 0, 1, … up to the first that is missing."""
    first: list[float] = []
    for seed in range(most):
        value = returns.get(seed)
        if value is None:
            break
        first.append(value)
    return np.array(first)
