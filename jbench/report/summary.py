"""Summary of a report: what was run, what is solved, and the conclusions."""

from collections import Counter
from collections.abc import Iterator, Sequence

import pandas as pd

from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.comparisons import Comparison
from jbench.report.analysis.examine import decide_solved
from jbench.report.analysis.scores import Summary
from jbench.report.analysis.statistics import DECIDING_SEEDS
from jbench.report.data.cells import OURS, SOLVED, Cell
from jbench.report.formatting import display_name
from jbench.report.request import Request
from jbench.report.tables import reduction_items, values
from jbench.report.views import View, cells_of
from jbench.wording import counted

_MAX_NAMED = 12
_MEANING = {
    "solved": "solved",
    "uncertain": f"the median is at {SOLVED} or more, but uncertain",
    "not solved": f"the median is below {SOLVED}",
}
"""States of a cell and what they mean."""


def sentences(
    request: Request,
    views: Sequence[View],
    findings: Sequence[Finding] | None,
    runs: pd.DataFrame,
) -> list[str]:
    """Returns the sentences of the summary.

    Args:
        views: one per kind of return, the leading one first.
        findings: on the claims; None if they were not requested.
        runs: rows of the table `runs`.
    """
    if not views[0].learned:
        return ["There are no runs yet, only encoders or evaluated policies."]
    lines = [_what_was_run(views, runs), *map(_what_is_solved, views), *_on_solved(views)]
    lead = views[0]
    if lead.reductions:
        lines += [
            f"Does reduction help? {text}" for text in reduction_items.answers("a", lead.reductions)
        ]
    if request.compare:
        lines += [sentence for view in views for sentence in _how_they_compare(view.comparisons)]
    if findings is None:
        return [*lines, "For verdicts on the paper's claims, type the same command with --claims."]
    lines += [f"({c}) {claim.text} {_verdict(c, findings)}" for c, claim in CLAIMS.items()]
    return [*lines, *_on_claims(findings)]


def _what_was_run(views: Sequence[View], runs: pd.DataFrame) -> str:
    """Returns a sentence on the number of runs and their cells, those of the results first."""
    cells = cells_of(views)
    count = sum(len(cell.seeds) for cell in cells)
    diverged = int(runs["diverged"].notna().sum())
    statuses = Counter(runs.loc[runs["diverged"].isna(), "status"])
    statuses["diverged"] = diverged
    names = ("unfinished", "failed", "diverged")
    other = [f"{statuses[name]} {name}" for name in names if statuses[name]]
    tasks = len({cell.task for cell in cells})
    named = [_described(cell) for cell in sorted(cells, key=lambda cell: cell.source != OURS)]
    return (
        f"{counted(count, 'run')} in {counted(len(cells), 'cell')} on {counted(tasks, 'task')}: "
        + formatting.listed(named, _MAX_NAMED)
        + (f". Of all runs, {' and '.join(other)}." if other else ".")
    )


def _described(cell: Cell) -> str:
    steps, count = values.trained(cell).text, values.count_of(cell, len(cell.seeds))
    return f"{values.cell_name(cell)}, {steps} control steps, {count}"


def _what_is_solved(view: View) -> str:
    """Returns a sentence on the cells that are solved according to one kind of return."""
    states: dict[str, list[str]] = {}
    for summary in view.statistics:
        state, text = _solved(summary)
        states.setdefault(state, []).append(f"{values.cell_name(summary.cell)} ({text})")
    solved = "; ".join(states.get("solved", ["nothing"]))
    sentence = (
        f"Solved by the {view.kind.long}, with the whole 95% interval of the median at {SOLVED} or "
        f"more, from at least {DECIDING_SEEDS} seeds: {solved}."
    )
    if "uncertain" in states:
        cells = "; ".join(states["uncertain"])
        sentence += f" The median is at {SOLVED} or more, but uncertain: {cells}."
    return sentence


def _solved(summary: Summary) -> tuple[str, str]:
    """Returns the state of a cell, and its median with its interval as text.

    The state is `solved`, `uncertain` or `not solved`: whether the median's interval, only the
    median, or neither is at 900 or more.
    """
    one = summary.get("final_return", "median")
    value = None if one is None else values.estimate(one.estimate, values.against_solved)
    if one is None or value is None:
        return "not solved", "no final return"
    text = f"{value.text}, {values.count_of(summary.cell, one.seeds)}"
    if one.estimate.value < SOLVED:
        return "not solved", text
    verdict, _ = decide_solved(one.estimate, one.seeds)
    return ("solved" if verdict == "supported" else "uncertain"), text


def _on_solved(views: Sequence[View]) -> list[str]:
    """Returns a sentence on the cells whose state depends on the kind of return, if any."""
    by_cell: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
    names: dict[tuple[str, ...], str] = {}
    for view in views:
        for summary in view.statistics:
            key = summary.cell.key
            by_cell.setdefault(key, {})[view.kind.name] = _solved(summary)
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


def _how_they_compare(found: Sequence[Comparison]) -> Iterator[str]:
    for one in found:
        improvement = values.estimate(one.improvement, formatting.ratio)
        gap = values.estimate(one.difference, formatting.signed)
        if improvement is not None and gap is not None:
            yield (
                f"{one.ours.task} {display_name(one.ours.algo)} {one.ours.representation_label}, "
                f"{one.ours.kind.plural}: a run of {one.ours.source} ends above one of "
                f"{one.theirs.source} with a probability of {improvement.text}; the interquartile "
                f"means differ by {gap.text} at {formatting.steps(one.control_steps)} control "
                f"steps (n = {one.seeds[0]}, {one.seeds[1]}; 95% intervals)."
            )


def _verdict(letter: str, findings: Sequence[Finding]) -> str:
    """Counts the verdicts on a claim for each source of runs and kind of return."""
    tested = [f for f in findings if f.claim == letter]
    if not tested:
        return "No runs test it."
    parts = []
    for source, returns in dict.fromkeys((f.source, f.returns) for f in tested):
        counts = Counter(f.verdict for f in tested if (f.source, f.returns) == (source, returns))
        text = ", ".join(f"{count} {name}" for name, count in counts.most_common())
        parts.append(f"{source}, {returns} returns: {text}")
    return f"{formatting.capitalized('; '.join(parts))}."


def _on_claims(findings: Sequence[Finding]) -> list[str]:
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
