"""Where the two kinds of return disagree: on what is solved, and on the paper's claims."""

from collections.abc import Sequence

from jbench.report.analysis.claims import Finding
from jbench.report.analysis.scores import Summary
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.cells import SOLVED
from jbench.report.tables import values
from jbench.report.views import View

STATES = ("solved", "not sure", "not solved")
"""Whether the median is at 900 or more: with its whole interval, without, or not at all."""

_SAID = {
    "solved": "solved",
    "not sure": "the median is there, but that is not sure",
    "not solved": "the median is below",
}


def solved(summary: Summary) -> tuple[str, str]:
    """Returns which of `STATES` a cell is in, and its median with its interval for a reader."""
    one = summary.get("final_return", "median")
    value = values.of_statistic(one)
    if one is None or value is None:
        return "not solved", "no final return"
    text = f"{value.text}, {values.count_of(summary.cell, one.seeds)}"
    if not one.estimate.value >= SOLVED:
        return "not solved", text
    sure = one.estimate.low >= SOLVED and one.seeds >= DECIDING_SEEDS
    return ("solved" if sure else "not sure"), text


def on_solved(views: Sequence[View]) -> list[str]:
    """Returns a sentence on the cells that only one kind of return calls solved, if any."""
    found: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
    names: dict[tuple[str, ...], str] = {}
    for view in views:
        for summary in view.statistics:
            key = summary.cell.key
            found.setdefault(key, {})[view.kind.name] = solved(summary)
            names[key] = values.cell_name(summary.cell)
    differing = [
        f"{names[key]} ({'; '.join(_of_kind(kind, *state) for kind, state in states.items())})"
        for key, states in found.items()
        if len({state for state, _ in states.values()}) > 1
    ]
    if not differing:
        return []
    return [
        f"Evaluation and training returns disagree on whether {SOLVED} is reached: "
        f"{'; '.join(differing)}."
    ]


def _of_kind(kind: str, state: str, text: str) -> str:
    return f"{kind} {text}: {_SAID[state]}"


def on_claims(findings: Sequence[Finding]) -> list[str]:
    """Returns a sentence for each claim on whose comparisons the kinds of return disagree."""
    verdicts: dict[tuple[str, str, str], dict[str, str]] = {}
    for one in findings:
        key = one.claim, one.source, one.compared
        verdicts.setdefault(key, {})[one.returns] = one.verdict
    said: dict[str, list[str]] = {}
    for (claim, source, compared), by_kind in verdicts.items():
        if len(set(by_kind.values())) > 1:
            text = ", ".join(f"{verdict} by {kind} returns" for kind, verdict in by_kind.items())
            said.setdefault(claim, []).append(f"{source}, {compared}: {text}")
    return [
        f"Evaluation and training returns disagree on ({claim}): {'; '.join(cases)}."
        for claim, cases in said.items()
    ]
