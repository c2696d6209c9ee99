"""Does reduction help? Every representation against the full and against the scaled observation.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore of
scaling and reduction together; a difference from `scaled`, the observation with the same scaling,
is of reduction alone.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from jbench.names import FULL, kind_of
from jbench.report import formatting
from jbench.report.analysis import statistics as st
from jbench.report.analysis.claims import CLAIMS, MARGIN, Finding
from jbench.report.analysis.examine import reduction_findings
from jbench.report.analysis.scores import scores_of
from jbench.report.data.cells import Cell
from jbench.report.data.curves import FloatArray
from jbench.report.data.returns import Returns
from jbench.report.data.variants import comparable
from jbench.report.document import TableItem, Value
from jbench.report.figures.learning_curves import display_name

SCALED = "scaled"
BASELINES = (FULL, SCALED)
"""What each reduced representation is compared with: without the encoders' scaling, and with it."""

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


class Reduction(NamedTuple):
    """A representation compared with a baseline, all other settings being equal.

    Attributes:
        cell: of the representation.
        baseline: `full` or `scaled`.
        findings: on the claims (a), (b) and (c).
        seeds: of the representation and of the baseline that have a final return.
    """

    cell: Cell
    baseline: str
    findings: Sequence[Finding]
    seeds: tuple[int, int]


class Point(NamedTuple):
    """Final returns of a representation.

    Attributes:
        cell: of the representation.
        latents: numbers that its agents see; None for the full observation.
        final: (seeds,) final returns.
        estimate: their interquartile mean with its 95% interval.
    """

    cell: Cell
    latents: int | None
    final: FloatArray
    estimate: st.Estimate


class Group(NamedTuple):
    """Cells that differ in their representation alone, compared at the same control step.

    Attributes:
        points: of each cell that has reached the control step.
        control_steps: at which they are compared.
        short: cells whose seeds have not reached it.
    """

    points: Sequence[Point]
    control_steps: int
    short: Sequence[Cell]


def latents_of(representation: str) -> int | None:
    """Returns how many numbers agents see of a representation; None for the full observation."""
    digits = representation.removeprefix(kind_of(representation))
    return int(digits) if digits else None


def reductions(cells: Sequence[Cell]) -> list[Reduction]:
    """Returns the comparisons of each reduced representation with each baseline that there is.

    Args:
        cells: of one kind of return.
    """
    found = []
    for group in _alike(cells):
        baselines = {kind_of(c.representation): c for c in reversed(group)}
        for cell in group:
            if kind_of(cell.representation) in BASELINES:
                continue
            for name in (name for name in BASELINES if name in baselines):
                findings = reduction_findings(baselines[name], cell)
                steps = findings[0].control_steps
                ours, theirs = (scores_of(one, steps).final for one in (cell, baselines[name]))
                found.append(Reduction(cell, name, findings, (len(ours), len(theirs))))
    return found


def groups(cells: Sequence[Cell]) -> list[Group]:
    """Returns the groups with a baseline and a reduced representation, to be drawn.

    The control step of a group is the last one of most of its cells; of several such, the latest.
    """
    found = []
    for group in _alike(cells):
        ends = [int(cell.last_step) for cell in group]
        end = max(ends, key=lambda step: (ends.count(step), step))
        points = [_point(cell, end) for cell, last in zip(group, ends, strict=True) if last >= end]
        short = [cell for cell, last in zip(group, ends, strict=True) if last < end]
        kinds = {kind_of(point.cell.representation) for point in points}
        if kinds & {*BASELINES} and kinds - {*BASELINES}:
            found.append(Group(points, end, short))
    return found


def _point(cell: Cell, control_steps: int) -> Point:
    final = scores_of(cell, control_steps).final
    estimate = st.estimate(st.interquartile_mean, [final])
    return Point(cell, latents_of(cell.representation), final, estimate)


def _alike(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Returns the cells of one robot that differ in nothing but their representation."""
    found: dict[tuple[str, str], list[Cell]] = {}
    for cell in (cell for cell in cells if not cell.robots):
        key = cell.source, comparable(cell.settings, "representation")
        found.setdefault(key, []).append(cell)
    return list(found.values())


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
    cell = one.cell
    name = f"{cell.prefix}{cell.task} {display_name(cell.algo)} {cell.seen}"
    effect = _effect(finding)
    return f"{name} ({effect.text if effect else 'no return'}; n = {one.seeds[0]}, {one.seeds[1]})"


def _effect(finding: Finding) -> Value | None:
    say = formatting.ratio if finding.claim == "b" else formatting.signed
    return formatting.estimate(finding.effect, say)


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
    for one, named in zip(found, formatting.names([one.cell for one in found]), strict=True):
        seeds = {"this": one.seeds[0], "baseline": one.seeds[1]}
        row = {**named, "numbers": latents_of(one.cell.representation), "against": one.baseline}
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


_HEADINGS = ("difference of the IQM", "ratio of standard deviations", "difference over the run")


def frame(found: Sequence[Group]) -> pd.DataFrame:
    """Returns what is drawn of the groups.

    Columns: source, task, algo, representation, settings (those that set a variant apart), returns
    (their kind), latents, control_steps, seeds, iqm, low, high (ends of its 95% interval), median.
    """
    return pd.DataFrame(
        [
            {
                "source": point.cell.source,
                "task": point.cell.task,
                "algo": point.cell.algo,
                "representation": point.cell.representation,
                "settings": point.cell.label,
                "returns": point.cell.kind.name,
                "latents": point.latents,
                "control_steps": group.control_steps,
                "seeds": len(point.final),
                "iqm": point.estimate.value,
                "low": point.estimate.low,
                "high": point.estimate.high,
                "median": float(np.median(point.final)) if len(point.final) else np.nan,
            }
            for group in found
            for point in group.points
        ]
    ).astype({"latents": "Int64"})
