"""Compares every representation with the full and with the scaled observation.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.
"""

from collections.abc import Iterator, Sequence
from statistics import multimode
from typing import Any

import numpy as np

from jbench.names import FULL, kind_of
from jbench.report.analysis import statistics as st
from jbench.report.analysis.agents import difference
from jbench.report.analysis.claims import MARGIN, Finding
from jbench.report.analysis.comparisons import compare
from jbench.report.analysis.examine import reduction_findings
from jbench.report.analysis.scores import compared_scores, scores_of
from jbench.report.data.cells import Cell, groups_same_but
from jbench.report.data.returns import signed, whole

SCALED = "scaled"
BASELINES = (FULL, SCALED)
"""Baselines of reduced representations, without and with the encoders' scaling."""

MARKS = {
    **dict.fromkeys(("higher", "less variable", "faster"), "✓"),
    **dict.fromkeys(("lower", "more variable", "slower"), "✗"),
    **{"similar": "=", "undecided": "?"},
}
"""A mark for each verdict; a check mark speaks for the representation."""

_WORDS = {
    ("b", "supported"): "less variable",
    ("b", "contradicted"): "more variable",
    ("c", "supported"): "faster",
    ("c", "contradicted"): "slower",
}


def verdicts(cells: Sequence[Cell]) -> Iterator[dict[str, Any]]:
    """Yields the verdicts (a) to (c) on each reduced representation against each baseline.

    Beside reduced representations, `scaled` is compared with `full`: the effect of scaling alone.

    Args:
        cells: of one kind of return.
    """
    for group in _by_settings(cells):
        baselines = {kind_of(cell.representation): cell for cell in reversed(group)}
        for cell in group:
            kind = kind_of(cell.representation)
            others = {FULL: (), SCALED: (FULL,)}.get(kind, BASELINES)
            for name in (name for name in others if name in baselines):
                for finding in reduction_findings(baselines[name], cell):
                    verdict, row = _verdict(finding, cell, baselines[name])
                    yield {
                        **cell.identity,
                        **{"returns": cell.kind.name, "against": name, "claim": finding.claim},
                        **{"verdict": verdict, "mark": MARKS[verdict], **row},
                        **{"seeds": finding.seeds, "steps": finding.control_steps},
                    }


def _verdict(finding: Finding, cell: Cell, baseline: Cell) -> tuple[str, dict[str, Any]]:
    """Returns the verdict on a claim in a word, and its numbers and sentence."""
    value, low, high, _ = finding.effect
    if finding.claim == "a":
        verdict, (value, low, high, _), text = _on_return(
            finding, compare(cell, baseline).difference
        )
        return verdict, _row(value, low, high, text, neutral=0.0, margin=MARGIN)
    verdict = _WORDS.get((finding.claim, finding.verdict), "undecided")
    if finding.claim == "b":
        ours, theirs = compared_scores(cell, baseline)
        value, low, high, _ = difference(ours.agents, theirs.agents)
        ends = f"standard deviation between agents {by(low, high)}"
        return verdict, _row(value, low, high, _sentence(verdict, value, low, ends, signed), 0.0)
    ends = f"mean return over the run {by(low, high)}"
    return verdict, _row(value, low, high, _sentence(verdict, value, low, ends, signed), 0.0)


def _row(
    value: float, low: float, high: float, text: str, neutral: float, margin: float = np.nan
) -> dict[str, Any]:
    numbers = {"value": value, "low": low, "high": high}
    return {**numbers, "neutral": neutral, "margin": margin, "text": text}


def _on_return(finding: Finding, outer: st.Estimate) -> tuple[str, st.Estimate, str]:
    """Returns the verdict on the final return, the interval behind it, and a sentence.

    Higher and lower are decided by the 95% interval of the difference, similar by two one-sided
    tests at 5%, which the 90% interval shows.
    """
    if finding.verdict == "supported":
        _, low, high, _ = finding.effect
        return "similar", finding.effect, f"similar: {by(low, high)}, within {MARGIN:g}"
    if finding.seeds < st.DECIDING_SEEDS or outer.low <= 0 <= outer.high or np.isnan(outer.low):
        ends = by(outer.low, outer.high)
        return "undecided", outer, _sentence("undecided", outer.value, outer.low, ends, signed)
    verdict = "higher" if outer.low > 0 else "lower"
    beyond = "yes" if finding.verdict == "contradicted" else "undecided"
    return verdict, outer, f"{by(outer.low, outer.high)}; by more than {MARGIN:g}: {beyond}"


def by(low: float, high: float) -> str:
    """Formats an interval of a difference: `higher by 38 to 114`, `-20 to +35`."""
    if np.isnan(low):
        return "an unknown difference"
    if low > 0:
        return f"higher by {whole(low)} to {whole(high)}"
    if high < 0:
        return f"lower by {whole(-high)} to {whole(-low)}"
    return f"{signed(low)} to {signed(high)}"


def _sentence(verdict: str, value: float, low: float, ends: str, form: Any) -> str:
    if np.isnan(value):
        return f"{verdict}: unknown"
    return f"{verdict}: {ends}" if np.isfinite(low) else f"{verdict}: {form(value)}, too few seeds"


def final_returns(cells: Sequence[Cell]) -> Iterator[dict[str, Any]]:
    """Yields the final returns of configurations that differ only in their representation.

    They are measured at the most frequent last step of these configurations, or at the latest of
    several such; those that have not reached it are left out.
    """
    for group in _by_settings(cells):
        end = max(multimode(int(cell.last_step) for cell in group))
        for cell in (cell for cell in group if cell.last_step >= end):
            final = scores_of(cell, end).final
            value, low, high, _ = st.estimate(st.interquartile_mean, [final])
            yield {
                **cell.identity,
                **{"returns": cell.kind.name, "steps": end, "seeds": len(final)},
                **{"iqm": value, "low": low, "high": high},
            }


def _by_settings(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Returns the groups on the plain robot that differ only in their representation."""
    plain = [cell for cell in cells if not cell.robots]
    groups = groups_same_but(plain, "representation")
    return [group for group in groups if len({kind_of(c.representation) for c in group}) > 1]
