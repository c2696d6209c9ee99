"""Answers to whether reduction helps: a sentence per claim, and a table of all comparisons."""

from collections.abc import Iterator, Sequence

import pandas as pd

from jbench.names import FULL
from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, MARGIN, Finding
from jbench.report.analysis.reduction import BASELINES, SCALED, Reduction, input_size
from jbench.report.document import TableItem, Value
from jbench.report.tables import values
from jbench.report.views import View

_OUTCOMES = {
    "a": {"higher": f"higher by more than {MARGIN:g}", "lower": f"lower by more than {MARGIN:g}"},
    "b": {"supported": "less variable", "contradicted": "more variable"},
    "c": {"supported": "faster", "contradicted": "slower"},
}
_MEASURES = {
    "a": "Final {kind} return",
    "b": "Standard deviation of the final {kind} return",
    "c": "Mean {kind} return over the run",
}
_HEADINGS = ("difference of the IQM", "ratio of standard deviations", "difference over the run")


def sentences(found: Sequence[Reduction]) -> list[str]:
    """Returns the answers on the claims (a) to (c), against each baseline."""
    return [text for letter in _OUTCOMES for text in answers(letter, found)]


def answers(letter: str, found: Sequence[Reduction]) -> list[str]:
    """Returns an answer on a claim (a, b or c) for each baseline that was compared with."""
    texts = []
    for name in BASELINES:
        against = [one for one in found if one.baseline == name]
        if against:
            measured = _MEASURES[letter].format(kind=against[0].cell.kind.name)
            counts = {one.seeds for one in against}
            n = f" ({_count(counts.pop())})" if len(counts) == 1 else ""
            outcomes = " ".join(_by_outcome(letter, against, each_count=not n))
            texts.append(f"({letter}) {measured} against {name}{n}. {outcomes}")
    return texts


def _by_outcome(letter: str, found: Sequence[Reduction], *, each_count: bool) -> Iterator[str]:
    """Yields a sentence for each outcome with its representations, the decided ones first."""
    one_task = len({one.cell.task for one in found}) == 1
    named: dict[str, list[str]] = {}
    for one in found:
        finding = one.finding(letter)
        numbers = [effect_text(finding)]
        if alone := values.by_episodes(finding):
            numbers.append(f"by episodes alone {alone.text}")
        if each_count:
            numbers.append(_count(one.seeds))
        name = one.cell.short_name if one_task else f"{one.cell.short_name} on {one.cell.task}"
        text = f"{name} ({'; '.join(numbers)})"
        named.setdefault(outcome(finding), []).append(text)
    order = [*_OUTCOMES[letter].values(), "similar", "undecided"]
    for name in sorted(named, key=order.index):
        yield f"{formatting.capitalized(name)}: {', '.join(named[name])}."


def _count(seeds: tuple[int, int]) -> str:
    return f"n = {seeds[0]}, {seeds[1]}"


def outcome(finding: Finding) -> str:
    """Returns the outcome for a representation, such as `slower`, `similar` or `undecided`."""
    outcomes, verdict = _OUTCOMES[finding.claim], finding.verdict
    if verdict == "undecided":
        return "undecided"
    if finding.claim != "a":
        return outcomes[verdict]
    if verdict == "supported":
        return "similar"
    return outcomes["higher" if finding.effect.value > 0 else "lower"]


def effect_text(finding: Finding) -> str:
    """Formats an effect with its interval."""
    effect = _effect(finding)
    return "no return" if effect is None else effect.text


def _effect(finding: Finding) -> Value | None:
    form = formatting.ratio if finding.claim == "b" else formatting.signed
    return values.estimate(finding.effect, form)


def table(view: View) -> TableItem | None:
    """Returns the table of all comparisons with a baseline; None if there are none."""
    found, kind = view.reductions, view.kind
    if not found:
        return None
    rows = []
    for one, named in zip(found, values.names([one.cell for one in found]), strict=True):
        size = input_size(one.cell.representation, one.cell.task)
        row = {**named, "input size": size, "against": one.baseline}
        row["n"] = values.counts(one.seeds, "baseline")
        row["at control step"] = values.at_step(one.findings[0].control_steps or 0)
        for finding, heading in zip(one.findings, _HEADINGS, strict=True):
            row[f"({finding.claim}) {heading}"] = _effect(finding)
            if finding.claim == "b":
                row["(b) ratio by episodes alone"] = values.by_episodes(finding)
            row[f"verdict on ({finding.claim})"] = outcome(finding)
        rows.append(row)
    return TableItem(
        view.file("reduction_tests"),
        f"Every representation against {FULL} and {SCALED}: {kind.plural}",
        f"Difference of the interquartile mean of the final {kind.name} return from that of the "
        f"baseline (90% interval, for the test whether it is within {MARGIN:g}); ratio of the "
        "standard deviation across seeds to the baseline's, and difference of the return over the "
        "run (95% intervals). The tests are those of the claims: "
        + " ".join(f"({letter}) {CLAIMS[letter].test}" for letter in _OUTCOMES),
        pd.DataFrame(rows),
        folded=True,
    )
