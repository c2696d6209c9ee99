"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of cells to which it applies (`examine.py`). The statistic, the
value that would refute it and the margin are the same for our runs, for the published curves, and
for both kinds of return.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import pandas as pd

from jbench.names import ReturnsName
from jbench.report.analysis import statistics as st
from jbench.report.data.cells import OURS

Verdict = Literal["supported", "contradicted", "undecided"]

MARGIN = 50.0
"""Difference in final return that counts as similar: 5% of the largest possible return."""

REDUCED = "dae12"
"""The paper's reduced order: 12 latents of a denoising autoencoder."""

OFF_POLICY = ("ddpg", "sac", "td3")
ON_POLICY = "ppo"

HARDER, EASIER = "move_in_direction", "face_direction"
"""The two tasks on which the paper compares the reduced order (Figures 8 and 7)."""

RANDOM_RETURNS = {EASIER: 220.0, HARDER: 303.0}
"""Median return of random actions in 100 episodes (`jbench evaluate --policy random`)."""

_EPISODES_VARY = (
    "The deviation includes the variation of the episodes that a final return averages, so the "
    "95% interval of the difference of the agents' own deviations has to exclude 0 as well; beside "
    "the ratio is the one that episodes alone would cause if all agents of a cell had the same "
    "expected return."
)


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, and the description of its test."""

    text: str
    test: str


CLAIMS = {
    "a": Claim(
        "With the reduced order the reward is similar.",
        "The interquartile means of the final returns differ by less than 50: the 90% interval "
        "of the difference lies within that margin (two one-sided tests at 5%).",
    ),
    "b": Claim(
        "With the reduced order the training varies less between seeds.",
        "The standard deviation of the final return across seeds is smaller: the 95% interval "
        f"of its ratio, reduced to full, lies below 1. {_EPISODES_VARY}",
    ),
    "c": Claim(
        "With the reduced order learning is slightly faster.",
        "The mean return over the whole run, the area under the learning curve, is larger: the "
        "95% interval of the difference of interquartile means lies above 0.",
    ),
    "d": Claim(
        "The gain of the reduced order is larger for the harder task.",
        "What (c) gains on move_in_direction less what it gains on face_direction: the 95% "
        "interval lies above 0. There is no verdict if (c) gains nothing on move_in_direction, or "
        "if both medians of a task are within 50 of that of random actions.",
    ),
    "e": Claim(
        "Off-policy algorithms reach higher medians than PPO.",
        "The difference of the median final returns: the 95% interval lies above 0.",
    ),
    "f": Claim(
        "Off-policy algorithms vary more between seeds than PPO.",
        "The standard deviation of the final return across seeds is larger: the 95% interval "
        f"of its ratio to PPO's lies above 1. {_EPISODES_VARY}",
    ),
    "g": Claim(
        "The task is solved.",
        "The median final return across seeds is 900 or more: the 95% interval lies there.",
    ),
    "h": Claim(
        "The hand-written policy solves the task.",
        "The median return of its episodes is 900 or more: the 95% interval lies there. The "
        "policy is deterministic, so here episodes are the unit of replication.",
    ),
}
"""Claims by their letters."""


class SeedsNeeded(NamedTuple):
    """Number of seeds that would decide a comparison, if the effect is as currently estimated.

    Attributes:
        seeds: number of seeds per cell.
        rule: origin of the number: a power of 80%, or the rule that fewer than six decide nothing.
    """

    seeds: int
    rule: Literal["80% power", "six-seed rule"]


@dataclass(frozen=True)
class Finding:
    """Result of one comparison that tests a claim.

    Attributes:
        claim: letter of the claim.
        compared: names of the cells.
        effect: the claim's statistic with the deciding interval.
        seeds: smallest number of seeds of the cells; for (h), number of episodes.
        seeds_needed: seeds that would decide it; None if it is decided or no number is known.
        control_steps: at which cells are compared; None for (h).
        source: `ours`, or the figure of the paper.
        by_episodes: for (b) and (f), the effect that episodes alone would cause if all agents of a
            cell had the same expected return; NaN if unknown.
    """

    claim: str
    compared: str
    effect: st.Estimate
    seeds: int
    verdict: Verdict
    seeds_needed: SeedsNeeded | None
    returns: ReturnsName
    control_steps: int | None = None
    source: str = OURS
    remark: str = ""
    by_episodes: float = math.nan


def findings_frame(findings: Sequence[Finding]) -> pd.DataFrame:
    """Returns a row per finding with the exact numbers of the tables.

    Columns: claim (letter), source, returns (kind), compared, seeds, control_steps (at which cells
    are compared), effect, low, high (ends of the interval: 90% for claim a, else 95%),
    effect_by_episodes (see `Finding`), verdict, seeds_needed, seeds_needed_by (rule), remark.
    """
    rows = [
        (
            *(one.claim, one.source, one.returns, one.compared, one.seeds, one.control_steps),
            *(*one.effect[:3], one.by_episodes),
            *(one.verdict, *(one.seeds_needed or (None, None)), one.remark),
        )
        for one in findings
    ]
    columns = ["claim", "source", "returns", "compared", "seeds", "control_steps"]
    columns += ["effect", "low", "high", "effect_by_episodes"]
    columns += ["verdict", "seeds_needed", "seeds_needed_by", "remark"]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.astype({"control_steps": "Int64", "seeds_needed": "Int64"})
