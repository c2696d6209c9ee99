"""Verdicts on representations against those that reduce nothing.

Comparisons that a shipped study plans have the verdict of its group-sequential test; the others are
corrected for their number.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.
"""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from jbench.names import RETURNS
from jbench.report.analysis.baselines import baseline_pairs
from jbench.report.analysis.decisions import Study
from jbench.report.analysis.judging import SEQUENTIAL, Comparison, Judgment, judge
from jbench.report.analysis.pair import Pair
from jbench.report.analysis.schedules import nothing_in_common, remark_on_schedules
from jbench.report.data.configuration import ID, Configuration, with_returns
from jbench.statistics import bootstrap as st
from jbench.statistics.verdicts import Evidence
from jbench.studies.quantities import QUANTITIES, SPEED, VARIABILITY, Quantity

VERDICTS = [
    *ID,
    "against",
    "baseline",
    "claim",
    "verdict",
    "mark",
    "value",
    "low",
    "high",
    "corrected_low",
    "corrected_high",
    "corrected_by",
    "text",
    "remark",
    "seeds",
    "steps",
]
_KEYS = ["configuration", "baseline", "claim", "returns"]


def verdict_frame(
    configurations: Sequence[Configuration],
    decisions: pd.DataFrame,
    studies: Sequence[Study] = (),
) -> pd.DataFrame:
    """Returns the verdicts on each reduced representation, and on `scaled`, the effect of scaling.

    They are of each of the `QUANTITIES`: of variability for three or more seeds. baseline is a
    configuration, value has a 95% interval, and the verdict rests on the corrected one.
    """
    listed = {
        tuple(row[key] for key in _KEYS): Judgment(
            row["verdict"], row["low"], row["high"], SEQUENTIAL
        )
        for row in decisions.to_dict("records")
    }
    rows: list[dict[str, Any]] = []
    for kind in RETURNS:
        asked = [
            _comparison(quantity, pair)
            for pair in baseline_pairs(with_returns(configurations, kind), studies)
            for quantity in QUANTITIES.values()
            if quantity is not VARIABILITY or _has_enough_seeds(pair)
        ]
        judgments: dict[Comparison, Judgment] = {}
        for comparison in asked:
            names = {**comparison.names, "claim": comparison.quantity.claim}
            judgment = listed.get(tuple(names[key] for key in _KEYS))
            if judgment is not None:
                judgments[comparison] = judgment

        for quantity in QUANTITIES.values():
            family = [one for one in asked if one.quantity is quantity and one not in judgments]
            judgments |= zip(family, judge(family), strict=True)

        rows += [comparison.row(judgments[comparison]) for comparison in asked]

    return pd.DataFrame(rows, columns=VERDICTS)


def _has_enough_seeds(pair: Pair) -> bool:
    """Returns whether both configurations have enough seeds for their variability."""
    return min(len(config.seeds) for config in pair.sides) >= st.MIN_SEEDS


def _comparison(quantity: Quantity, pair: Pair) -> Comparison:
    """Compares final returns, the variability between agents, or means over the run."""
    names = {
        **pair.ours.identity,
        "baseline": pair.theirs.configuration,
        "against": pair.theirs.identity["representation"],
        "seeds": pair.seeds,
        "steps": pair.control_steps,
    }
    remark = remark_on_schedules(pair, quantity)
    unknown = ""
    if quantity is VARIABILITY and not nothing_in_common(pair):
        unknown = pair.unknown_variability

    return Comparison(quantity, names, _evidence(quantity, pair), remark, unknown)


def _evidence(quantity: Quantity, pair: Pair) -> Evidence:
    """Returns what the seeds of a pair say about a quantity."""
    if quantity is VARIABILITY:
        return pair.variability()
    if quantity is SPEED:
        return pair.difference("area")
    return pair.difference("final", pair.ours.margin)
