"""The verdicts as the page and the terminal show them: representations down, baselines across."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.comparison_tables import COMPARED
from jbench.report.data.source_names import OWN
from jbench.report.frames import Frames
from jbench.report.numbers import rounded
from jbench.statistics.bootstrap import DECIDING_SEEDS
from jbench.studies.deciding import MARGIN

_STATES = {"✓": "for", "✗": "against"}


@dataclass(frozen=True)
class VerdictMatrix:
    """Verdicts on representations that are compared with the same baselines.

    Attributes:
        baselines: names of the representations that are compared with.
        claims: what is said of each, by claim.
        groups: by task and algorithm in words, a row for each representation. Its `verdicts` are
            a cell for each claim against the first baseline, then against the next; a cell is None
            where nothing was compared.
    """

    baselines: Sequence[str]
    claims: Mapping[str, str]
    groups: Mapping[str, Sequence[Mapping[str, Any]]]

    @property
    def row_count(self) -> int:
        """Number of representations, each counted for every task and algorithm."""
        return sum(len(rows) for rows in self.groups.values())


def verdict_matrices(frames: Frames) -> list[VerdictMatrix]:
    """Returns the verdicts, apart for representations that have no baseline in common.

    Those on the most representations come first.
    """
    verdicts = frames.lead(frames.verdicts)
    # Half of the width of a claim's small axis; few intervals reach beyond it.
    ends = verdicts.melt("claim", ["low", "high"], value_name="end").replace(np.inf, np.nan)
    scales = ends["end"].astype(float).abs().groupby(ends["claim"]).quantile(0.9).fillna(1.0)
    families: list[list[str]] = []
    for _, compared in verdicts.groupby("configuration", sort=False)["against"]:
        met = [family for family in families if compared.isin(family).any()]
        families = [family for family in families if family not in met]
        families.append(list(dict.fromkeys([*chain(*met), *compared])))

    matrices = [
        _verdict_matrix(verdicts[verdicts["against"].isin(family)], family, scales)
        for family in families
    ]
    return sorted(matrices, key=lambda matrix: matrix.row_count, reverse=True)


def _verdict_matrix(
    verdicts: pd.DataFrame, baselines: Sequence[str], scales: "pd.Series[float]"
) -> VerdictMatrix:
    """Returns the verdicts against some baselines; `scales` are widths of axes by claim."""
    claims = {claim: title for claim, title in COMPARED.items() if claim in {*verdicts["claim"]}}
    keys = [(name, claim) for name in baselines for claim in claims]
    groups: dict[str, list[dict[str, Any]]] = {}
    for _, group in verdicts.groupby("configuration", sort=False):
        first = group.iloc[0]
        known = {(row["against"], row["claim"]): row for row in group.to_dict("records")}
        shown = [_verdict(known[k], scales[k[1]]) if k in known else None for k in keys]
        source = "" if first["source"] == OWN else first["source"]
        about = ", ".join(filter(None, (first["task"], first["algo"], source)))
        row = {**first[["representation", "words"]], "verdicts": shown}
        groups.setdefault(about, []).append(row)

    return VerdictMatrix(baselines, claims, groups)


def _verdict(row: Mapping[Any, Any], reach: float) -> dict[str, Any]:
    """Returns a verdict with the places of its intervals on a small axis, 120 wide."""

    def at(value: float) -> float:
        return round(60 + 56 * float(np.nan_to_num(np.clip(value / (reach or 1), -1, 1))), 1)

    value, low, high = (rounded(row[name]) for name in ("value", "low", "high"))
    interval = f" [{low}, {high}]" if np.isfinite([row["low"], row["high"]]).all() else ""
    enough = row["seeds"] >= DECIDING_SEEDS and np.isfinite(row["corrected_low"])
    undecided = "undecided" if enough else "too few seeds"
    ends = ("value", "low", "high", "corrected_low", "corrected_high")
    places = {name: at(row[name]) for name in ends}
    return {
        **row,
        **places,
        "verdict": undecided if row["verdict"] == "undecided" else row["verdict"],
        "size": "" if np.isnan(row["value"]) else value,
        "numbers": f"uncorrected: {value}{interval}, {row['seeds']} seeds",
        "state": _STATES.get(row["mark"], "for" if row["verdict"] == "similar" else "open"),
        "margin": (at(-MARGIN), at(MARGIN)) if row["claim"] == "a" else None,
    }
