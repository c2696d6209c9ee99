"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of configurations to which it applies (`examine.py`). The statistic,
the value that would refute it and the margin are the same for our runs, for the published curves,
and for both kinds of return.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.data.configuration import OWN
from jbench.report.data.returns import SOLVED, ratio, signed, whole
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import seeds_to_decide

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

COLUMNS = [
    *("claim", "statement", "test", "source", "returns", "compared", "seeds", "steps"),
    *("effect", "low", "high", "by_episodes", "verdict", "seeds_needed", "seeds_needed_by"),
    *("remark", "text"),
]

_AGENTS = (
    "and that of the difference of the agents' own deviations, without their episodes, excludes 0"
)

CLAIMS = {
    "a": (
        "With the reduced order the reward is similar.",
        "The 90% interval of the difference of interquartile means of final returns lies within "
        "50.",
    ),
    "b": (
        "With the reduced order the training varies less between seeds.",
        f"The 95% interval of the ratio of standard deviations lies below 1, {_AGENTS}.",
    ),
    "c": (
        "With the reduced order learning is slightly faster.",
        "The 95% interval of the difference of mean returns over the run lies above 0.",
    ),
    "d": (
        "The gain of the reduced order is larger for the harder task.",
        "The 95% interval of the gain of (c) on move_in_direction less that on face_direction lies "
        "above 0; no verdict if nothing is gained, or if agents are close to random actions.",
    ),
    "e": (
        "Off-policy algorithms reach higher medians than PPO.",
        "The 95% interval of the difference of median final returns lies above 0.",
    ),
    "f": (
        "Off-policy algorithms vary more between seeds than PPO.",
        f"The 95% interval of the ratio of standard deviations lies above 1, {_AGENTS}.",
    ),
    "g": (
        "The task is solved.",
        "The 95% interval of the median final return lies at 900 or more.",
    ),
    "h": ("The hand-written policy solves the task.", "As (g), for the episodes of the policy."),
}
"""Claims and their tests by letter."""


Row = dict[str, Any]
"""Columns of a row of `claim_frame`."""


def finding(
    claim: str, compared: str, effect: st.Estimate, seeds: int, decided: Row, **more: Any
) -> Row:
    """Returns the result of one comparison that tests a claim.

    Args:
        claim: letter of the claim.
        compared: names of the configurations.
        effect: the claim's statistic with the deciding interval.
        seeds: smallest number of seeds of the configurations; for (h), number of episodes.
        decided: see `decide`.
        more: other columns: returns; steps, at which configurations are compared; source (`own`,
            another source, or the figure of the paper); remark; by_episodes: for (b) and (f), the
            effect that episodes alone would cause if all agents of a configuration had the same
            expected return.
    """
    value, low, high, _ = effect
    form = ratio if claim in "bf" else whole if claim in "gh" else signed
    interval = f" [{form(low)}, {form(high)}]" if np.isfinite([low, high]).all() else ""
    text = f"{decided['verdict']}: {'unknown' if np.isnan(value) else form(value)}{interval}"
    statement, test = CLAIMS[claim]
    row = {"claim": claim, "statement": statement, "test": test, "source": OWN, "seeds": seeds}
    row |= {"compared": compared, "effect": value, "low": low, "high": high, "remark": ""}
    return row | {"text": text, "by_episodes": np.nan} | decided | more


def claim_frame(findings: Iterable[Row]) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper, in the order of the claims."""
    rows = sorted(findings, key=lambda row: str(row["claim"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64", "seeds_needed": "Int64"})


UNDECIDED: Row = {"verdict": "undecided", "seeds_needed": None, "seeds_needed_by": ""}


def decide(effect: st.Estimate, seeds: int, boundary: float, *, logarithmic: bool = False) -> Row:
    """Returns the verdict on a claim that an effect is above a boundary, and the seeds needed.

    Columns: verdict (supported, contradicted, undecided), seeds_needed (per configuration, if the
    effect is as now estimated; None if it is decided or no number is known) and seeds_needed_by: a
    power of 80%, or the rule that fewer than six decide nothing.

    Args:
        effect: with its 95% interval.
        seeds: number of seeds per group.
        boundary: the claim holds above it.
        logarithmic: whether the effect is a ratio, for which distances are logarithmic.
    """
    enough = seeds >= st.DECIDING_SEEDS
    if enough and effect.low > boundary:
        return UNDECIDED | {"verdict": "supported"}
    if enough and effect.high < boundary:
        return UNDECIDED | {"verdict": "contradicted"}
    distance, error = effect.value - boundary, effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / boundary), error / effect.value
    return _undecided(distance, error, seeds)


def decide_solved(median: st.Estimate, seeds: int) -> Row:
    """Returns the verdict on a median return of `SOLVED` or more; see `decide`."""
    return decide(median, seeds, SOLVED - 1e-9)  # a median of exactly 900 solves a task


def decide_similar(inner: st.Estimate, outer: st.Estimate, seeds: int) -> Row:
    """Returns the verdict on a claim that two groups of seeds are similar; see `decide`.

    Args:
        inner: the difference with its 90% interval (two one-sided tests at 5%).
        outer: the difference with its 95% interval.
        seeds: number of seeds per group.
    """
    enough = seeds >= st.DECIDING_SEEDS
    if enough and inner.low > -MARGIN and inner.high < MARGIN:
        return UNDECIDED | {"verdict": "supported"}
    if enough and (outer.low > MARGIN or outer.high < -MARGIN):
        return UNDECIDED | {"verdict": "contradicted"}
    return _undecided(MARGIN - abs(inner.value), inner.standard_error, seeds)


def _undecided(distance: float, standard_error: float, seeds: int) -> Row:
    """Returns the seeds needed according to `seeds_to_decide`, but at least six."""
    needed = seeds_to_decide(distance, standard_error, seeds)
    if needed is None:
        return UNDECIDED
    rule = "80% power"
    if seeds < st.DECIDING_SEEDS and needed <= st.DECIDING_SEEDS:
        needed, rule = st.DECIDING_SEEDS, "six-seed rule"
    return UNDECIDED | {"seeds_needed": needed, "seeds_needed_by": rule}


def ratio_of_widths(ours: float, theirs: float) -> float:
    """Returns the ratio of two deviations or widths of bands; NaN for a width of 0."""
    return ours / theirs if theirs > 0 else np.nan
