"""Does reduction help? A sentence for each claim and the table of all comparisons."""

from collections.abc import Iterator, Sequence

import pandas as pd

from jbench.names import FULL
from jbench.report import formatting
from jbench.report.analysis.claims import CLAIMS, MARGIN, Finding
from jbench.report.analysis.reduction import BASELINES, SCALED, Reduction, numbers_seen
from jbench.report.data.returns import Returns
from jbench.report.document import TableItem, Value
from jbench.report.tables import values

_SAID = {
    "a": {"higher": f"higher by more than {MARGIN:g}", "lower": f"lower by more than {MARGIN:g}"},
    "b": {"supported": "less spread", "contradicted": "more spread"},
    "c": {"supported": "faster", "contradicted": "slower"},
}
_MEASURES = {
    "a": "Final {kind} return",
    "b": "Standard deviation of the final {kind} return",
    "c": "Mean {kind} return over the run",
}
_HEADINGS = ("difference of the IQM", "ratio of standard deviations", "difference over the run")


def sentences(found: Sequence[Reduction], kind: Returns) -> list[str]:
    """Returns a sentence for each of the claims (a) to (c): which representations do what."""
    return [sentence(letter, found, kind) for letter in _SAID] if found else []


def sentence(letter: str, found: Sequence[Reduction], kind: Returns) -> str:
    """Returns what all comparisons say of a claim.

    Args:
        letter: of the claim: a, b or c.
        found: at least one comparison.
        kind: of the returns.
    """
    there = [name for name in BASELINES if any(one.baseline == name for one in found)]
    against = [f"against {name}, {'; '.join(_by_outcome(letter, found, name))}" for name in there]
    measured = _MEASURES[letter].format(kind=kind.name)
    return f"({letter}) {measured}: {'; '.join(against)}."


def _by_outcome(letter: str, found: Sequence[Reduction], baseline: str) -> Iterator[str]:
    """Gives the representations of each outcome, the decided ones first."""
    named: dict[str, list[str]] = {}
    for one in (one for one in found if one.baseline == baseline):
        finding = next(f for f in one.findings if f.claim == letter)
        named.setdefault(outcome(finding), []).append(_named(one, finding))
    order = [*_SAID[letter].values(), "similar", "undecided"]
    for name in sorted(named, key=order.index):
        yield f"{name}: {', '.join(named[name])}"


def outcome(finding: Finding) -> str:
    """Returns what a finding says of a representation: `slower`, `similar`, `undecided`."""
    said, verdict = _SAID[finding.claim], finding.verdict
    if verdict == "undecided":
        return "undecided"
    if finding.claim != "a":
        return said[verdict]
    if verdict == "supported":
        return "similar"
    return said["higher" if finding.effect.value > 0 else "lower"]


def _named(one: Reduction, finding: Finding) -> str:
    effect, (ours, theirs) = _effect(finding), one.seeds
    text = effect.text if effect else "no return"
    return f"{values.cell_name(one.cell)} ({text}; n = {ours}, {theirs})"


def _effect(finding: Finding) -> Value | None:
    say = formatting.ratio if finding.claim == "b" else formatting.signed
    return values.estimate(finding.effect, say)


def table(found: Sequence[Reduction], kind: Returns, name: str) -> TableItem | None:
    """Returns the table of all comparisons; None where there is none.

    Args:
        found: comparisons of one kind of return.
        kind: of the returns.
        name: of its files.
    """
    if not found:
        return None
    rows = []
    for one, named in zip(found, values.names([one.cell for one in found]), strict=True):
        seeds = {"this": one.seeds[0], "baseline": one.seeds[1]}
        numbers = numbers_seen(one.cell.representation, one.cell.task)
        row = {**named, "numbers": numbers, "against": one.baseline}
        row["n"] = Value(f"{one.seeds[0]}, {one.seeds[1]}", min(one.seeds), numbers=seeds)
        steps = one.findings[0].control_steps or 0
        row["at control step"] = Value(formatting.steps(steps), steps)
        for finding, heading in zip(one.findings, _HEADINGS, strict=True):
            row[f"({finding.claim}) {heading}"] = _effect(finding)
            row[f"verdict on ({finding.claim})"] = outcome(finding)
        rows.append(row)
    return TableItem(
        name,
        f"Every representation against {FULL} and {SCALED}: {kind.plural}",
        f"By how much the interquartile mean of the final {kind.name} return differs from that of "
        f"the baseline (90% interval, for the test whether it is within {MARGIN:g}); the standard "
        "deviation across seeds as a multiple of the baseline's, and by how much the return over "
        "the run differs (95% intervals). The tests are those of the claims: "
        + " ".join(f"({letter}) {CLAIMS[letter].test}" for letter in _SAID),
        pd.DataFrame(rows),
    )
