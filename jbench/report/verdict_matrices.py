"""The verdicts as the page and the terminal show them: representations down, baselines across."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.numbers import signed, texts
from jbench.report.analysis.judging import SEQUENTIAL
from jbench.report.data.source_names import OWN
from jbench.report.frames import Frames
from jbench.report.once import once
from jbench.statistics.verdicts import DECIDING_SEEDS
from jbench.studies.quantities import FINAL_RETURN, QUANTITIES

_STATES = {"✓": "for", "✗": "against"}

_BASELINES = 2
"""Most baselines that a table has beside each other, so that a laptop shows it whole."""


@dataclass(frozen=True)
class VerdictCell:
    """A verdict on one claim against one baseline, with an interval to draw.

    Numbers are places on an axis of the length 120, of which 60 is no difference.

    Attributes:
        claim: its letter.
        against: name of the baseline.
        mark: a character for the verdict.
        verdict: a word or two: whether the representation is better, or why this is not known.
        state: whether the verdict speaks `for` the representation, `against` it, or is `open`.
        size: the difference as text; empty if it is unknown.
        text: the verdict in words.
        numbers: the difference with its uncorrected interval and the seeds, in words.
        corrected_by: how the verdict is corrected for the other comparisons; empty if it is not.
        value: the difference.
        low, high: ends of its interval alone.
        corrected_low, corrected_high: ends of the corrected interval.
        margin: ends of the differences that count as similar; None for claims without such.
    """

    claim: str
    against: str
    mark: str
    verdict: str
    state: str
    size: str
    text: str
    numbers: str
    corrected_by: str
    value: float
    low: float
    high: float
    corrected_low: float
    corrected_high: float
    margin: tuple[float, float] | None


@dataclass(frozen=True)
class VerdictRow:
    """The verdicts on a representation.

    Attributes:
        representation: its name.
        words: other settings of its agents.
        verdicts: a cell for each claim against the first baseline, then against the next; None
            where nothing was compared.
    """

    representation: str
    words: str
    verdicts: Sequence[VerdictCell | None]


@dataclass(frozen=True)
class VerdictMatrix:
    """Verdicts on representations that are compared with the same baselines.

    Attributes:
        baselines: names of the representations that are compared with.
        claims: what is said of each, by claim.
        groups: by task and algorithm in words, a row for each representation.
    """

    baselines: Sequence[str]
    claims: Mapping[str, str]
    groups: Mapping[str, Sequence[VerdictRow]]

    @property
    def row_count(self) -> int:
        """Number of representations, each counted for every task and algorithm."""
        return sum(len(rows) for rows in self.groups.values())


@once
def verdict_matrices(frames: Frames) -> list[VerdictMatrix]:
    """Returns the verdicts in tables, that of the most representations first."""
    verdicts = frames.lead(frames.verdicts)
    # Half of the width of a claim's small axis; few intervals reach beyond it.
    ends = verdicts.melt("claim", ["low", "high"], value_name="end").replace(np.inf, np.nan)
    scales = ends["end"].astype(float).abs().groupby(ends["claim"]).quantile(0.9).fillna(1.0)
    matrices = []
    for baselines, configurations in tables_of_verdicts(verdicts):
        shown = verdicts["configuration"].isin(configurations)
        rows = verdicts[shown & verdicts["against"].isin(baselines)]
        matrices.append(_verdict_matrix(rows, baselines, scales, frames.margins))

    return sorted(matrices, key=lambda matrix: matrix.row_count, reverse=True)


def tables_of_verdicts(verdicts: pd.DataFrame) -> list[tuple[list[str], list[str]]]:
    """Returns the baselines of each table, and the configurations that are compared with them.

    A configuration is in the table of its own baselines, or in one that has these and others. A
    table of more than `_BASELINES` is divided.
    """
    compared = {
        str(configuration): list(dict.fromkeys(against))
        for configuration, against in verdicts.groupby("configuration", sort=False)["against"]
    }
    families: dict[frozenset[str], list[str]] = {}
    for baselines in compared.values():
        if not any({*baselines} < {*others} for others in compared.values()):
            families.setdefault(frozenset(baselines), baselines)

    members: dict[frozenset[str], list[str]] = {family: [] for family in families}
    for configuration, baselines in compared.items():
        family = next(family for family in families if family.issuperset(baselines))
        members[family].append(configuration)

    return [
        (baselines[first : first + _BASELINES], members[family])
        for family, baselines in families.items()
        for first in range(0, len(baselines), _BASELINES)
    ]


def _verdict_matrix(
    verdicts: pd.DataFrame,
    baselines: Sequence[str],
    scales: "pd.Series[float]",
    margins: Mapping[str, float],
) -> VerdictMatrix:
    """Returns the verdicts against some baselines.

    Args:
        verdicts: rows of the frame of verdicts.
        baselines: names of the representations that are compared with.
        scales: widths of axes by claim.
        margins: by task; see `Frames.margins`.
    """
    judged = {*verdicts["claim"]}
    claims = {claim: each.title for claim, each in QUANTITIES.items() if claim in judged}
    groups: dict[str, list[VerdictRow]] = {}
    for _, group in verdicts.groupby("configuration", sort=False):
        cells = {
            (row["against"], row["claim"]): _cell(row, scales[row["claim"]], margins)
            for row in group.to_dict("records")
        }
        first = group.iloc[0]
        row = VerdictRow(
            representation=first["representation"],
            words=first["words"],
            verdicts=[cells.get(place) for place in product(baselines, claims)],
        )
        source = "" if first["source"] == OWN else first["source"]
        about = ", ".join(filter(None, (first["task"], first["algo"], source)))
        groups.setdefault(about, []).append(row)

    return VerdictMatrix(baselines, claims, groups)


def _cell(row: Mapping[Any, Any], reach: float, margins: Mapping[str, float]) -> VerdictCell:
    """Returns the cell of a row of the frame of verdicts; the axis ends at a difference `reach`."""

    def at(value: float) -> float:
        return round(60 + 56 * float(np.nan_to_num(np.clip(value / (reach or 1), -1, 1))), 1)

    similar = margins[row["task"]] if row["claim"] == FINAL_RETURN.claim else 0.0
    ends = [row["low"], row["high"]]
    difference, interval = texts(signed, row["value"], ends if np.isfinite(ends).all() else [])

    verdict = row["verdict"]
    # The sequential test has an interval, and may decide, with fewer seeds.
    is_tested = row["seeds"] >= DECIDING_SEEDS or row["corrected_by"] == SEQUENTIAL
    if np.isnan(row["value"]):
        verdict = "unknown"
    elif verdict == "undecided" and not (is_tested and np.isfinite(row["corrected_low"])):
        verdict = "too few seeds"

    return VerdictCell(
        claim=row["claim"],
        against=row["against"],
        mark=row["mark"],
        verdict=verdict,
        state=_STATES.get(row["mark"], "for" if row["verdict"] == "similar" else "open"),
        size="" if np.isnan(row["value"]) else difference,
        text=row["text"],
        numbers=f"uncorrected: {f'{difference} {interval}'.rstrip()}, {row['seeds']} seeds",
        corrected_by=row["corrected_by"],
        value=at(row["value"]),
        low=at(row["low"]),
        high=at(row["high"]),
        corrected_low=at(row["corrected_low"]),
        corrected_high=at(row["corrected_high"]),
        margin=(at(-similar), at(similar)) if similar else None,
    )
