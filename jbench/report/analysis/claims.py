"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of configurations to which it applies (`examine.py`). The statistic,
the value that would refute it and the margin are the same for our runs, for the published curves,
and for both kinds of return.

A finding is a row with the claim's letter, what is compared, the effect (the claim's statistic with
the deciding interval), the number of seeds, and the columns of `decide`.
"""

from collections.abc import Iterable
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.data.configuration import OWN
from jbench.report.data.returns import SOLVED, ratio, signed, whole
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import seeds_to_decide

MARGIN = 50.0  # difference in final return that is similar: 5% of the largest possible return
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
}  # claims and their tests by letter

Row = dict[str, Any]  # columns of a row of `claim_frame`
UNDECIDED: Row = {"verdict": "undecided", "seeds_needed": None, "seeds_needed_by": ""}


def claim_frame(findings: Iterable[dict[Any, Any]]) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper, in the order of the claims."""
    usual: Row = {"source": OWN, "by_episodes": np.nan, "remark": ""} | UNDECIDED
    rows = [usual | finding for finding in findings]
    for row in rows:
        row["statement"], row["test"] = CLAIMS[row["claim"]]
        form = ratio if row["claim"] in "bf" else whole if row["claim"] in "gh" else signed
        value, *ends = (row[name] for name in ("effect", "low", "high"))
        interval = f" [{', '.join(map(form, ends))}]" if np.isfinite(ends).all() else ""
        known = "unknown" if np.isnan(value) else form(value)
        row["text"] = f"{row['verdict']}: {known}{interval}"
    rows.sort(key=lambda row: str(row["claim"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64", "seeds_needed": "Int64"})


def published_findings(task: str | None, algo: str | None) -> list[dict[Any, Any]]:
    """Returns the findings on the paper's curves of a task and an algorithm; None: of all.

    With ten seeds, the band from the 10th to the 90th percentile is an interval of the median
    (`docs/claims.md`); the uncertainty of a band's width is unknown. Returns at the end of training
    are compared; for (c) and (d), the mean of the median over training.
    """
    file = resources.files("jbench.paper").joinpath("published_claims.csv")
    rows = pd.read_csv(str(file), keep_default_na=False, na_values={"low": "", "high": ""})
    for name, value in (("task", task), ("algo", algo)):
        rows = rows if value is None else rows[rows[name] == value]
    return rows.to_dict("records")


def decide(
    effect: st.Estimate,
    seeds: int,
    low: float = -np.inf,
    high: float = np.inf,
    *,
    outer: st.Estimate | None = None,
    logarithmic: bool = False,
) -> Row:
    """Returns the verdict on a claim that an effect is between two numbers, and the seeds needed.

    Columns: verdict (supported, contradicted, undecided), seeds_needed (per configuration, if the
    effect is as now estimated; None if it is decided or no number is known) and seeds_needed_by: a
    power of 80%, or the rule that fewer than six decide nothing.

    Args:
        effect: with the interval that supports the claim.
        outer: the effect with the interval that contradicts it, if it is another one.
        logarithmic: whether the effect is a ratio, whose distance from `low` is logarithmic.
    """
    against = outer or effect
    if seeds >= st.DECIDING_SEEDS:
        if effect.low > low and (effect.high < high or np.isinf(high)):
            return UNDECIDED | {"verdict": "supported"}
        if against.high < low or against.low > high:
            return UNDECIDED | {"verdict": "contradicted"}
    distance, error = min(effect.value - low, high - effect.value), effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / low), error / effect.value
    needed = seeds_to_decide(distance, error, seeds)
    if needed is None:
        return UNDECIDED
    rule = "80% power"
    if seeds < st.DECIDING_SEEDS and needed <= st.DECIDING_SEEDS:
        needed, rule = st.DECIDING_SEEDS, "six-seed rule"
    return UNDECIDED | {"seeds_needed": needed, "seeds_needed_by": rule}


def decide_solved(median: st.Estimate, seeds: int) -> Row:
    """Returns the verdict on a median return of `SOLVED` or more; see `decide`."""
    return decide(median, seeds, SOLVED - 1e-9)  # a median of exactly 900 solves a task
