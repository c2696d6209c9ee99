"""Tests the paper's claims on every pair of cells to which they apply."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jbench.names import FULL
from jbench.report.analysis import statistics as st
from jbench.report.analysis.agents import difference
from jbench.report.analysis.claims import (
    EASIER,
    HARDER,
    MARGIN,
    OFF_POLICY,
    ON_POLICY,
    RANDOM_RETURNS,
    REDUCED,
    Finding,
    SeedsNeeded,
    Verdict,
)
from jbench.report.analysis.comparisons import algorithm_pairs
from jbench.report.analysis.scores import Scores, compared_scores
from jbench.report.data.cells import SOLVED, Cell
from jbench.report.data.curves import FloatArray
from jbench.report.data.returns import EVALUATION
from jbench.report.formatting import steps

# Quantiles of the normal distribution, for a two-sided test at 5% and for a power of 80%.
_SIGNIFICANCE, _POWER = 1.959964, 0.841621
_MAX_SEEDS = 1_000_000  # limit of a recommendation


def examine(cells: Sequence[Cell]) -> list[Finding]:
    """Returns findings on the claims (a) to (g) in order, from cells of one kind of return.

    Two cells are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about; each pair at the last control step that every seed of both has reached.
    """
    findings = []
    for source in dict.fromkeys(cell.source for cell in cells):
        plain = [cell for cell in cells if cell.source == source and not cell.robots]
        found = [*_of_representation(plain), *_of_algorithms(plain), *map(_solved, plain)]
        findings += [replace(finding, source=source) for finding in found]
    return sorted(findings, key=lambda finding: finding.claim)


def _solved(cell: Cell) -> Finding:
    (scores,) = compared_scores(cell)
    return _solves("g", cell.name_in_source, scores.final, **_common(cell))


def examine_heuristic(task: str, returns: FloatArray) -> Finding:
    """Returns the finding on claim (h) from returns (episodes,) of a task's hand-written policy."""
    return _solves("h", task, returns, returns=EVALUATION.name)


def _solves(letter: str, compared: str, values: FloatArray, **more: Any) -> Finding:
    effect = st.estimate(st.median, [values])
    verdict = decide_solved(effect, len(values))
    return Finding(letter, compared, effect, len(values), *verdict, **more)


def _common(*cells: Cell) -> dict[str, Any]:
    """Returns the fields that all findings on the same cells share."""
    common = int(min(cell.last_step for cell in cells))
    return {"returns": cells[0].kind.name, "control_steps": common, "remark": _cut(*cells)}


def _cut(*cells: Cell) -> str:
    """Returns a remark if some seeds have fewer control steps than others; else an empty text."""
    common, longest = min(cell.last_step for cell in cells), max(cell.longest for cell in cells)
    if common == longest:
        return ""
    return f"at {steps(common)} of {steps(longest)} control steps, the last that every seed has"


def decide(
    effect: st.Estimate, seeds: int, boundary: float, *, logarithmic: bool = False
) -> tuple[Verdict, SeedsNeeded | None]:
    """Returns the verdict on a claim that an effect is above a boundary, and the seeds needed.

    Args:
        effect: with its 95% interval.
        seeds: number of seeds per group.
        boundary: the claim holds above it.
        logarithmic: whether the effect is a ratio, for which distances are logarithmic.
    """
    enough = seeds >= st.DECIDING_SEEDS
    if enough and effect.low > boundary:
        return "supported", None
    if enough and effect.high < boundary:
        return "contradicted", None
    distance, error = effect.value - boundary, effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / boundary), error / effect.value
    return "undecided", _needed(distance, error, seeds)


def decide_solved(median: st.Estimate, seeds: int) -> tuple[Verdict, SeedsNeeded | None]:
    """Returns the verdict on a median return of `SOLVED` or more, and the seeds needed."""
    return decide(median, seeds, SOLVED - 1e-9)  # a median of exactly 900 solves a task


def _needed(distance: float, standard_error: float, seeds: int) -> SeedsNeeded | None:
    """Returns the seeds needed according to `seeds_to_decide`, but at least six."""
    by_power = seeds_to_decide(distance, standard_error, seeds)
    if by_power is None:
        return None
    if seeds < st.DECIDING_SEEDS and by_power <= st.DECIDING_SEEDS:
        return SeedsNeeded(st.DECIDING_SEEDS, "six-seed rule")
    return SeedsNeeded(by_power, "80% power")


def seeds_to_decide(distance: float, standard_error: float, seeds: int) -> int | None:
    """Returns the seeds per group that decide a comparison with a power of 80% at 5%, two-sided.

    The standard error falls with the root of the number of seeds; the true effect is assumed to
    equal the observed one (Cohen, 1988, chapter 2, by the normal approximation).

    Args:
        distance: of the effect from the deciding value.
        standard_error: of the effect at the present number of seeds.
        seeds: present number of seeds per group.

    Returns:
        None if the distance is 0 or unknown, or if more than a million seeds were needed.
    """
    if not (np.isfinite(distance) and np.isfinite(standard_error)) or distance == 0:
        return None
    root = abs((_SIGNIFICANCE + _POWER) * standard_error / distance)
    if root > np.sqrt(_MAX_SEEDS / seeds):
        return None
    return max(st.MIN_SEEDS, int(np.ceil(seeds * root**2)))


def decide_similar(
    inner: st.Estimate, outer: st.Estimate, seeds: int
) -> tuple[Verdict, SeedsNeeded | None]:
    """Returns the verdict on a claim that two groups are similar, and the seeds needed.

    Args:
        inner: the difference with its 90% interval.
        outer: the difference with its 95% interval.
        seeds: number of seeds per group.
    """
    enough = seeds >= st.DECIDING_SEEDS
    if enough and inner.low > -MARGIN and inner.high < MARGIN:
        return "supported", None
    if enough and (outer.low > MARGIN or outer.high < -MARGIN):
        return "contradicted", None
    return "undecided", _needed(MARGIN - abs(inner.value), inner.standard_error, seeds)


def _of_representation(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Yields findings on (a) to (d): the reduced order against the full observation."""
    pairs = [(reduced, full) for full in cells for reduced in cells if _reduces(reduced, full)]
    for reduced, full in pairs:
        yield from reduction_findings(full, reduced)
    for harder, easier in ((h, e) for h in pairs for e in pairs if _harder(h[1], e[1])):
        scores = [*compared_scores(*harder), *compared_scores(*easier)]
        effect = st.estimate(_gain_of_gains, *([one.area] for one in scores))
        seeds = min(len(one.area) for one in scores)
        full = harder[1]
        compared = " ".join(filter(None, (full.algo, full.label)))
        untested = _no_gain_to_compare(scores)
        verdict, needed = decide(effect, seeds, 0)
        yield Finding(
            "d",
            f"{compared}: {HARDER} against {EASIER}",
            effect,
            seeds,
            "undecided" if untested else verdict,
            None if untested else needed,
            returns=full.kind.name,
            control_steps=min(one.control_steps for one in scores),
            remark="; ".join(filter(None, (untested, _cut(*harder), _cut(*easier)))),
        )


def _no_gain_to_compare(scores: Sequence[Scores]) -> str:
    """Returns why the gains of two tasks test nothing on claim (d); else an empty text.

    Args:
        scores: of the harder task's reduced order and full observation, then of the easier task's.
    """
    for task, pair in ((HARDER, scores[:2]), (EASIER, scores[2:])):
        random = RANDOM_RETURNS[task]
        if all(abs(np.median(one.final) - random) <= MARGIN for one in pair if len(one.final)):
            return (
                f"no verdict, on {task} both are within {MARGIN:g} of random actions ({random:g})"
            )
    gain = _gain([scores[0].area], [scores[1].area])
    return "" if gain > 0 else f"no verdict, nothing is gained on {HARDER} ({gain:+.0f})"


def reduction_findings(baseline: Cell, reduced: Cell) -> list[Finding]:
    """Returns findings on (a), (b) and (c) from two cells that differ in their representation."""
    ours, theirs = compared_scores(reduced, baseline)
    compared = f"{reduced.name_in_source} against {baseline.representation}"
    seeds = min(len(theirs.final), len(ours.final))
    more = _common(baseline, reduced)
    iqm = st.difference(st.interquartile_mean)
    final = [ours.final], [theirs.final]
    inner = st.estimate(iqm, *final, confidence=0.9)
    outer, spread = st.estimates([iqm, st.ratio(st.standard_deviation)], *final)
    faster = st.estimate(iqm, [ours.area], [theirs.area])
    return [
        Finding("a", compared, inner, seeds, *decide_similar(inner, outer, seeds), **more),
        _on_variability("b", compared, spread, (ours, theirs), more),
        Finding("c", compared, faster, seeds, *decide(faster, seeds, 0), **more),
    ]


def _of_algorithms(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Yields findings on (e) and (f): off-policy algorithms against PPO."""
    for one, two in algorithm_pairs(cells):
        ppo, other = (one, two) if one.algo == ON_POLICY else (two, one)
        if ppo.algo != ON_POLICY or other.algo not in OFF_POLICY:
            continue
        ours, theirs = compared_scores(other, ppo)
        compared = f"{other.name_in_source} against {ON_POLICY}"
        seeds = min(len(theirs.final), len(ours.final))
        more = _common(ppo, other)
        statistics = [st.difference(st.median), st.ratio(st.standard_deviation)]
        higher, wider = st.estimates(statistics, [ours.final], [theirs.final])
        yield Finding("e", compared, higher, seeds, *decide(higher, seeds, 0), **more)
        yield _on_variability("f", compared, wider, (ours, theirs), more)


def _on_variability(
    letter: str,
    compared: str,
    ratio: st.Estimate,
    scores: tuple[Scores, Scores],
    more: dict[str, Any],
) -> Finding:
    """Returns the finding that the first agents vary less (b) or more (f) than the second ones.

    It is undecided if the variation of the episodes may explain the ratio.
    """
    ours, theirs = scores
    seeds = min(len(ours.final), len(theirs.final))
    verdict, needed = decide(ratio, seeds, 1.0, logarithmic=True)
    agents = difference(ours.agents, theirs.agents)
    shown = {"supported": agents.low > 0, "contradicted": agents.high < 0}
    remark = more["remark"]
    if not shown.get(verdict, True):
        interval = f"{agents.value:+.0f} [{agents.low:+.0f}, {agents.high:+.0f}]"
        known = math.isfinite(agents.value)
        reason = f"difference {interval}" if known else "unknown"
        verdict, remark = (
            "undecided",
            "; ".join(filter(None, (f"of the agents alone: {reason}", remark))),
        )
    if letter == "b":
        verdict = _opposite(verdict)
    alone = _ratio_by_episodes(ours, theirs)
    more = {**more, "remark": remark}
    return Finding(letter, compared, ratio, seeds, verdict, needed, by_episodes=alone, **more)


def _ratio_by_episodes(ours: Scores, theirs: Scores) -> float:
    """Returns the ratio of the standard deviations that episodes alone would cause."""
    theirs_alone = theirs.deviation_by_episodes
    return ours.deviation_by_episodes / theirs_alone if theirs_alone > 0 else math.nan


def _reduces(reduced: Cell, full: Cell) -> bool:
    same = (full.task, full.algo) == (reduced.task, reduced.algo)
    named = (full.representation, reduced.representation) == (FULL, REDUCED)
    return same and named and full.same_but(reduced, "representation")


def _harder(one: Cell, other: Cell) -> bool:
    named = (one.task, other.task) == (HARDER, EASIER)
    return named and one.algo == other.algo and one.same_but(other, "task")


_gain = st.difference(st.interquartile_mean)


def _gain_of_gains(
    harder_reduced: st.Strata,
    harder_full: st.Strata,
    easier_reduced: st.Strata,
    easier_full: st.Strata,
) -> FloatArray:
    return _gain(harder_reduced, harder_full) - _gain(easier_reduced, easier_full)


def _opposite(verdict: Verdict) -> Verdict:
    swapped: dict[Verdict, Verdict] = {"supported": "contradicted", "contradicted": "supported"}
    return swapped.get(verdict, verdict)
