"""Frames of configurations that are compared: verdicts, pairs, profiles, two sides, claims."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jbench.report.analysis import comparisons, reduction
from jbench.report.analysis import statistics as st
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.comparisons import Comparison
from jbench.report.analysis.scores import scores_of
from jbench.report.data.cells import ID, Cell, in_order, of_kind
from jbench.report.data.returns import KINDS, ratio, signed, whole

VERDICTS = [
    *(*ID, "returns", "against", "claim", "verdict", "mark", "value", "low", "high", "neutral"),
    *("margin", "text", "seeds", "steps"),
]
PAIRS = [
    *("task", "returns", "a", "b", "a_label", "b_label", "a_kind", "b_kind"),
    *("p", "low", "high", "decided", "steps"),
]
PROFILES = [*ID, "returns", "seeds", "final_return", "share", "low", "high"]
COMPARISONS = [
    *("task", "algo", "representation", "words", "returns", "a", "b", "seeds_a", "seeds_b"),
    *("steps", "p", "p_low", "p_high", "difference", "low", "high"),
    *("median_difference", "median_low", "median_high", "text"),
]
CLAIM_COLUMNS = [
    *("claim", "statement", "test", "source", "returns", "compared", "seeds", "steps"),
    *("effect", "low", "high", "by_episodes", "verdict", "seeds_needed", "seeds_needed_by"),
    *("remark", "text"),
]

ALL_TASKS = "all tasks"
THRESHOLDS = np.linspace(0, 1000, 201)
"""Episode returns at which a profile is computed."""


def verdict_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns the verdicts on representations, for both kinds of return; see `reduction`."""
    found = [row for kind in KINDS.values() for row in reduction.verdicts(of_kind(cells, kind))]
    return pd.DataFrame(found, columns=VERDICTS)


def pair_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns the probability that a run of configuration a ends above one of b, both ways.

    Columns: task, returns, a, b (configurations), their labels and kinds of representation, p with
    its 95% interval (low, high), decided (whether 0.5 is outside of it), steps (of training).

    Args:
        cells: of one kind of return.
    """
    found = []
    for one, other, (p, low, high, _) in comparisons.pairs(cells):
        for a, b, *numbers in ((one, other, p, low, high), (other, one, 1 - p, 1 - high, 1 - low)):
            row: dict[str, Any] = {"task": a.task, "returns": a.kind.name, "steps": int(a.longest)}
            for side, cell in (("a", a), ("b", b)):
                row |= {side: cell.configuration, f"{side}_label": cell.label}
                row |= {f"{side}_kind": cell.identity["kind"]}
            row |= dict(zip(("p", "low", "high"), numbers, strict=True))
            found.append(row | {"decided": not numbers[1] <= 0.5 <= numbers[2]})
    return pd.DataFrame(found, columns=PAIRS)


def profile_frame(cells: Sequence[Cell]) -> pd.DataFrame:
    """Returns the share of runs above each return (Agarwal et al., 2021, section 4.2).

    The rows of `ALL_TASKS` are of the configurations that were trained on each task; every task has
    the same weight. Columns: `ID`, returns, seeds, final_return, share, low, high (pointwise 95%
    interval, for at least three seeds).

    Args:
        cells: of one kind of return.
    """
    groups: dict[str, dict[tuple[str, int], list[Cell]]] = {}
    for cell in (cell for cell in cells if len(scores_of(cell).final)):
        line = cell.label, int(cell.steps.max())
        groups.setdefault(cell.task, {}).setdefault(line, []).append(cell)
    if len(groups) > 1:
        first, *others = groups.values()
        shared = [line for line in first if all(line in lines for lines in others)]
        groups[ALL_TASKS] = {line: [lines[line][0] for lines in groups.values()] for line in shared}
    parts = [pd.DataFrame(columns=PROFILES)]
    for task in in_order(groups):
        for same in groups[task].values():
            strata = [scores_of(cell).final for cell in same]
            low = high = np.full(len(THRESHOLDS), np.nan)
            if min(map(len, strata)) >= st.MIN_SEEDS:
                low, high = st.profile_interval(strata, THRESHOLDS)
            names = {**same[0].identity, "task": task, "returns": same[0].kind.name}
            numbers = {"seeds": sum(map(len, strata)), "final_return": THRESHOLDS}
            numbers |= {"share": st.performance_profile(strata, THRESHOLDS)}
            parts.append(pd.DataFrame({**names, **numbers, "low": low, "high": high}))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def comparison_frame(found: Sequence[Comparison]) -> pd.DataFrame:
    """Returns a row per comparison of two sides, ours minus theirs, with 95% intervals."""
    return pd.DataFrame(map(_comparison, found), columns=COMPARISONS)


def _comparison(one: Comparison) -> dict[str, Any]:
    p, difference, medians = one.improvement, one.difference, one.medians
    names = {name: one.ours.identity[name] for name in COMPARISONS[:4]}
    row: dict[str, Any] = {
        **names,
        "returns": one.ours.kind.name,
        "a": one.ours.source,
        "b": one.theirs.source,
    }
    row |= {"seeds_a": one.seeds[0], "seeds_b": one.seeds[1], "steps": one.control_steps}
    for columns, estimate in zip(
        (COMPARISONS[10:13], COMPARISONS[13:16], COMPARISONS[16:19]),
        (p, difference, medians),
        strict=True,
    ):
        row |= dict(zip(columns, estimate, strict=False))
    text = f"{row['a']} {reduction.by(difference.low, difference.high)}"
    if np.isnan(difference.low):
        text = f"{signed(difference.value)}, too few seeds"
    return {**row, "text": text}


def claim_frame(findings: Sequence[Finding]) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper; see `claims.Finding`."""
    return pd.DataFrame(map(_claim, findings), columns=CLAIM_COLUMNS).astype(
        {"steps": "Int64", "seeds_needed": "Int64"}
    )


def _claim(one: Finding) -> dict[str, Any]:
    value, low, high, _ = one.effect
    form = ratio if one.claim in "bf" else whole if one.claim in "gh" else signed
    effect = "unknown" if np.isnan(value) else form(value)
    interval = f" [{form(low)}, {form(high)}]" if np.isfinite([low, high]).all() else ""
    needed, rule = one.seeds_needed or (None, "")
    claim = CLAIMS[one.claim]
    return {
        **{"claim": one.claim, "statement": claim.text, "test": claim.test},
        **{"source": one.source, "returns": one.returns, "compared": one.compared},
        **{"seeds": one.seeds, "steps": one.control_steps},
        **{"effect": value, "low": low, "high": high, "by_episodes": one.by_episodes},
        **{"verdict": one.verdict, "seeds_needed": needed, "seeds_needed_by": rule},
        **{"remark": one.remark, "text": f"{one.verdict}: {effect}{interval}"},
    }
