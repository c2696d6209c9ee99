"""Disagreements between the two kinds of return, on solved tasks and on the paper's claims."""

from collections.abc import Sequence

from jbench.report.analysis.claims import Finding
from jbench.report.analysis.scores import Summary
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.cells import SOLVED
from jbench.report.tables import values
from jbench.report.views import View

_MEANING = {
    "solved": "solved",
    "uncertain": f"the median is at {SOLVED} or more, but uncertain",
    "not solved": f"the median is below {SOLVED}",
}
"""States of a cell and what they mean."""


def solved(summary: Summary) -> tuple[str, str]:
    """Returns the state of a cell, and its median with its interval as text.

    The state is `solved`, `uncertain` or `not solved`: whether the median's interval, only the
    median, or neither is at 900 or more.
    """
    one = summary.get("final_return", "median")
    value = values.of_statistic(summary, "final_return", "median")
    if one is None or value is None:
        return "not solved", "no final return"
    text = f"{value.text}, {values.count_of(summary.cell, one.seeds)}"
    if not one.estimate.value >= SOLVED:
        return "not solved", text
    certain = one.estimate.low >= SOLVED and one.seeds >= DECIDING_SEEDS
    return ("solved" if certain else "uncertain"), text


def on_solved(views: Sequence[View]) -> list[str]:
    """Returns a sentence on the cells whose state depends on the kind of return, if any."""
    by_cell: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
    names: dict[tuple[str, ...], str] = {}
    for view in views:
        for summary in view.statistics:
            key = summary.cell.key
            by_cell.setdefault(key, {})[view.kind.name] = solved(summary)
            names[key] = values.cell_name(summary.cell)
    differing = [
        f"{names[key]} ("
        + "; ".join(f"{kind} {text}: {_MEANING[state]}" for kind, (state, text) in states.items())
        + ")"
        for key, states in by_cell.items()
        if len({state for state, _ in states.values()}) > 1
    ]
    if not differing:
        return []
    return [
        f"Evaluation and training returns disagree on whether {SOLVED} is reached: "
        f"{'; '.join(differing)}."
    ]


def on_claims(findings: Sequence[Finding]) -> list[str]:
    """Returns a sentence for each claim with comparisons on which the kinds of return disagree."""
    verdicts: dict[tuple[str, str, str], dict[str, str]] = {}
    for one in findings:
        key = one.claim, one.source, one.compared
        verdicts.setdefault(key, {})[one.returns] = one.verdict
    disagreements: dict[str, list[str]] = {}
    for (claim, source, compared), by_kind in verdicts.items():
        if len(set(by_kind.values())) > 1:
            text = ", ".join(f"{verdict} by {kind} returns" for kind, verdict in by_kind.items())
            disagreements.setdefault(claim, []).append(f"{source}, {compared}: {text}")
    return [
        f"Evaluation and training returns disagree on ({claim}): {'; '.join(cases)}."
        for claim, cases in disagreements.items()
    ]
