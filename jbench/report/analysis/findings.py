"""Findings of runs on a claim of the paper: effect, verdict, and the seeds that would decide it.

A claim has a rule of its own, `claim_verdict`, not that of `statistics.verdicts`: its test was
fixed before there were data, so it has the whole error rate, and it says that an effect, which may
be a ratio or a median, lies between two numbers.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from jbench.report.data.source_names import OWN
from jbench.returns import EVALUATION
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import seeds_to_decide
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.studies.quantities import FINAL_RETURN, SPEED, VARIABILITY
from jbench.task_specs import SOLVED_RETURN

# The letters of the claims, as claims.csv and docs/claims.md have them.
SIMILAR_RETURN = FINAL_RETURN.claim
VARIES_LESS = VARIABILITY.claim
FASTER = SPEED.claim
GAINS_MORE = "d"
OFF_POLICY_HIGHER = "e"
OFF_POLICY_VARIES_MORE = "f"
SOLVED = "g"
SOLVED_BY_HAND = "h"

VERDICTS_ON_CLAIMS = ("supported", "contradicted", "undecided")


@dataclass(frozen=True)
class ClaimVerdict:
    """The verdict on a claim, and how many seeds would decide it.

    Attributes:
        verdict: one of `VERDICTS_ON_CLAIMS`.
        seeds_needed: per configuration, if the effect is as now estimated; None if it is decided
            or no number is known.
        seeds_needed_by: a power of 80%, or the rule that fewer than six decide nothing.
    """

    verdict: str = "undecided"
    seeds_needed: int | None = None
    seeds_needed_by: str = ""


@dataclass(frozen=True)
class Finding:
    """What runs say about a claim.

    Attributes:
        claim: its letter.
        effect: the claim's statistic with the deciding interval.
        seeds: the smaller number of the configurations.
        steps: control steps at which they are compared; None for policies.
        by_episodes: the effect that episodes alone would cause if all agents of a configuration
            had the same expected return; NaN if it is unknown.
    """

    claim: str
    compared: str
    effect: st.Estimate
    seeds: int
    decided: ClaimVerdict
    returns: str = EVALUATION
    source: str = OWN
    steps: int | None = None
    by_episodes: float = np.nan
    remark: str = ""

    def row(self) -> dict[str, Any]:
        """Returns the columns of `claim_frame` that a finding has."""
        return {
            "claim": self.claim,
            "source": self.source,
            "returns": self.returns,
            "compared": self.compared,
            "seeds": self.seeds,
            "steps": self.steps,
            "effect": self.effect.value,
            "low": self.effect.low,
            "high": self.effect.high,
            "by_episodes": self.by_episodes,
            "verdict": self.decided.verdict,
            "seeds_needed": self.decided.seeds_needed,
            "seeds_needed_by": self.decided.seeds_needed_by,
            "remark": self.remark,
        }


def claim_verdict(
    effect: st.Estimate,
    seeds: int,
    low: float = -np.inf,
    high: float = np.inf,
    *,
    outer: st.Estimate | None = None,
    logarithmic: bool = False,
) -> ClaimVerdict:
    """Returns the verdict on a claim that an effect is between two numbers, and the seeds needed.

    Args:
        effect: with the interval that supports the claim.
        outer: the effect with the interval that contradicts it, if it is another one.
        logarithmic: whether the effect is a ratio, whose distance from `low` is logarithmic.
    """
    against = outer or effect
    if seeds >= DECIDING_SEEDS:
        if effect.low > low and (effect.high < high or np.isinf(high)):
            return ClaimVerdict("supported")
        if against.high < low or against.low > high:
            return ClaimVerdict("contradicted")

    distance = min(effect.value - low, high - effect.value)
    error = effect.standard_error
    if logarithmic and effect.value > 0:
        distance = float(np.log(effect.value / low))
        error = error / effect.value

    needed = seeds_to_decide(distance, error, seeds)
    if needed is None:
        return ClaimVerdict()
    if seeds < DECIDING_SEEDS and needed <= DECIDING_SEEDS:
        return ClaimVerdict(seeds_needed=DECIDING_SEEDS, seeds_needed_by="six-seed rule")

    return ClaimVerdict(seeds_needed=needed, seeds_needed_by="80% power")


def solved_verdict(median: st.Estimate, seeds: int) -> ClaimVerdict:
    """Returns the verdict on a median return of `SOLVED_RETURN` or more; see `claim_verdict`."""
    just_below = SOLVED_RETURN - 1e-9  # a median of exactly 900 solves a task
    return claim_verdict(median, seeds, just_below)
