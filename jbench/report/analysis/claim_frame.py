"""The frame of the tests of the paper's claims, and the findings on the paper's own curves."""

from collections.abc import Callable, Collection, Iterable
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from jbench.numbers import ratio, signed, whole, with_interval
from jbench.report.analysis.findings import (
    OFF_POLICY_VARIES_MORE,
    SOLVED,
    SOLVED_BY_HAND,
    VARIES_LESS,
    Finding,
)

COLUMNS = [
    "claim",
    "statement",
    "test",
    "source",
    "returns",
    "compared",
    "seeds",
    "steps",
    "effect",
    "low",
    "high",
    "by_episodes",
    "verdict",
    "seeds_needed",
    "seeds_needed_by",
    "remark",
    "text",
]

_FORMS: dict[str, Callable[[float], str]] = {
    VARIES_LESS: ratio,
    OFF_POLICY_VARIES_MORE: ratio,
    SOLVED: whole,
    SOLVED_BY_HAND: whole,
}
"""How effects read in texts; those of other claims are differences."""


def paper_claims() -> pd.DataFrame:
    """Returns the statement and the test of each claim, with its letter as index."""
    file = resources.files("jbench.paper").joinpath("claims.csv")
    return pd.read_csv(str(file), index_col="claim")


def claim_frame(
    findings: Iterable[Finding] = (), published: Iterable[dict[Any, Any]] = ()
) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper, in the order of the claims.

    Published findings are rows of `published_findings`.
    """
    claims = paper_claims()
    usual = {"by_episodes": np.nan, "seeds_needed": None, "seeds_needed_by": "", "remark": ""}
    rows = [finding.row() for finding in findings] + [usual | row for row in published]
    rows = [claims.loc[row["claim"]].to_dict() | row for row in rows]
    for row in rows:
        row["text"] = _text(row)
    rows.sort(key=lambda row: str(row["claim"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64", "seeds_needed": "Int64"})


def _text(row: dict[str, Any]) -> str:
    """Returns a finding as the table shows it: the verdict, the effect and its interval."""
    form = _FORMS.get(row["claim"], signed)
    value = row["effect"]
    ends = (row["low"], row["high"])
    known_ends = ends if np.isfinite(ends).all() else ()
    known = "unknown" if np.isnan(value) else with_interval(form, value, known_ends)
    return f"{row['verdict']}: {known}"


def published_findings(task: str | None, algos: Collection[str]) -> list[dict[Any, Any]]:
    """Returns the findings on the paper's curves of a task and some algorithms.

    None is every task, and no algorithm every algorithm.

    With ten seeds, the band from the 10th to the 90th percentile is an interval of the median
    (`docs/claims.md`); the uncertainty of a band's width is unknown. Returns at the end of training
    are compared; for speed and the gain of it, the mean of the median over training.
    """
    file = resources.files("jbench.paper").joinpath("published_claims.csv")
    rows = pd.read_csv(str(file), keep_default_na=False, na_values={"low": "", "high": ""})
    if task is not None:
        rows = rows[rows["task"] == task]
    if algos:
        rows = rows[rows["algo"].isin(algos)]

    return rows.to_dict("records")
