"""Verdicts on representations against those that reduce nothing.

Comparisons that a shipped study plans have the verdict of its group-sequential test; the others are
corrected for their number.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.
"""

from collections.abc import Sequence
from functools import cache, partial

import pandas as pd

from jbench.names import RETURNS
from jbench.report.analysis.baselines import with_baselines
from jbench.report.analysis.decisions import StudyComparison
from jbench.report.analysis.judging import SEQUENTIAL, Comparison, judge
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair
from jbench.report.data.configuration import ID, Configuration, with_returns
from jbench.statistics import bootstrap as st
from jbench.studies.deciding import margin
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
    "seeds",
    "steps",
]
_KEYS = ["configuration", "baseline", "claim", "returns"]


def verdict_frame(
    configurations: Sequence[Configuration],
    decisions: pd.DataFrame,
    planned: Sequence[Sequence[StudyComparison]] = (),
) -> pd.DataFrame:
    """Returns the verdicts on each reduced representation, and on `scaled`, the effect of scaling.

    They are of each of the `QUANTITIES`: of variability for three or more seeds. baseline is a
    configuration, value has a 95% interval, and the verdict rests on the corrected one.
    """
    listed = {tuple(row[key] for key in _KEYS): row for row in decisions.to_dict("records")}
    every: list[Comparison] = []
    for kind in RETURNS:
        asked = [
            _comparison(quantity, pair)
            for pair in with_baselines(with_returns(configurations, kind), planned)
            for quantity in QUANTITIES.values()
            if quantity is not VARIABILITY or _has_enough_seeds(pair)
        ]
        for comparison in asked:
            names = {**comparison.names, "claim": comparison.quantity.claim}
            decided = listed.get(tuple(names[key] for key in _KEYS))
            if decided is not None:
                comparison.conclude(decided["verdict"], decided["low"], decided["high"], SEQUENTIAL)

        for quantity in QUANTITIES.values():
            judge([one for one in asked if one.quantity is quantity and one.judgment is None])
        every += asked

    return pd.DataFrame([comparison.row() for comparison in every], columns=VERDICTS)


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
    similar_within = margin(pair.ours.task)
    if quantity is VARIABILITY:
        estimate = pair.agents_difference()

        def interval(confidence: float) -> tuple[float, float]:
            _, low, high, _ = pair.agents_difference(confidence)
            return low, high

        @cache
        def p_value(_: float) -> float:
            return pair.p_value_of_variability()

    else:
        scores = "area" if quantity is SPEED else "final"
        sample = pair.sample(IQM_DIFFERENCE, scores)
        estimate = sample.estimate()
        interval = sample.interval
        p_value = cache(partial(pair.p_value, scores))

    return Comparison(quantity, names, estimate, interval, p_value, pair.decidable, similar_within)
