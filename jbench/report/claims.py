"""The paper's claims, each with the comparison that tests it, stated before looking at data.

A claim is tested on every pair of cells that it speaks of. The statistic, the value that would
refute it and the margin are fixed here, in code, and are the same for our runs and for the
published curves.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report import statistics as st
from jbench.report.cells import OURS, Cell
from jbench.report.comparisons import algorithm_pairs
from jbench.report.curves import FloatArray
from jbench.report.drawing import SOLVED
from jbench.report.scores import Scores, common_episodes, scores_of

Verdict = Literal["supported", "contradicted", "undecided"]

MARGIN = 50.0
"""Difference in final return that counts as similar: 5% of the largest possible return."""

REDUCED = "dae12"
"""The paper's reduced order: 12 latents of a denoising autoencoder."""

OFF_POLICY = ("ddpg", "sac", "td3")
ON_POLICY = "ppo"

HARDER, EASIER = "move_in_direction", "face_direction"
"""The two tasks on which the paper compares the reduced order (Figures 8 and 7)."""


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper.

    Attributes:
        letter: by which the report refers to it.
        text: what is claimed.
        test: what decides it, for a reader.
    """

    letter: str
    text: str
    test: str


CLAIMS = {
    claim.letter: claim
    for claim in (
        Claim(
            "a",
            "With the reduced order the reward is similar.",
            "The interquartile means of the final returns differ by less than 50: the 90% interval "
            "of the difference lies within that margin (two one-sided tests at 5%).",
        ),
        Claim(
            "b",
            "With the reduced order the training varies less between seeds.",
            "The standard deviation of the final return across seeds is smaller: the 95% interval "
            "of its ratio, reduced to full, lies below 1.",
        ),
        Claim(
            "c",
            "With the reduced order learning is slightly faster.",
            "The mean return over the whole of training, the area under the learning curve, is "
            "larger: the 95% interval of the difference of interquartile means lies above 0.",
        ),
        Claim(
            "d",
            "The gain of the reduced order is larger for the harder task.",
            "What (c) gains on move_in_direction less what it gains on face_direction: the 95% "
            "interval lies above 0.",
        ),
        Claim(
            "e",
            "Off-policy algorithms reach higher medians than PPO.",
            "The difference of the median final returns: the 95% interval lies above 0.",
        ),
        Claim(
            "f",
            "Off-policy algorithms vary more between seeds than PPO.",
            "The standard deviation of the final return across seeds is larger: the 95% interval "
            "of its ratio to PPO's lies above 1.",
        ),
        Claim(
            "g",
            "The task is solved.",
            "The median final return across seeds is 900 or more: the 95% interval lies there.",
        ),
        Claim(
            "h",
            "The hand-written policy solves the task.",
            "The median return of its episodes is 900 or more: the 95% interval lies there. The "
            "policy is deterministic, so here episodes are the unit of replication.",
        ),
    )
}


@dataclass(frozen=True)
class Finding:
    """What one comparison says of a claim.

    Attributes:
        claim: its letter.
        compared: the cells, for a reader.
        effect: the statistic of the claim, with the interval that decides.
        seeds: the fewest of the cells compared; for (h), episodes.
        verdict: on the claim, by this comparison.
        seeds_needed: of each cell, that would decide it at 80% power; None if it is decided, or
            if no number can be said.
        episodes: of each seed that are compared; for (h), None.
        source: `ours`, or the figure of the paper.
        remark: what a reader must know of this comparison; may be empty.
    """

    claim: str
    compared: str
    effect: st.Estimate
    seeds: int
    verdict: Verdict
    seeds_needed: int | None
    episodes: int | None = None
    source: str = OURS
    remark: str = ""


def examine(cells: Sequence[Cell]) -> list[Finding]:
    """Returns what runs say of the claims (a) to (g), in their order.

    Cells are compared where both are of the same results, on the plain robot, and differ in nothing
    else than the claim speaks of; each pair is cut to the episodes that every seed of both has.
    """
    findings = []
    for source in dict.fromkeys(cell.source for cell in cells):
        plain = [cell for cell in cells if cell.source == source and not cell.robots]
        found = [*_of_representation(plain), *_of_algorithms(plain), *map(_solved, plain)]
        findings += [replace(finding, source=source) for finding in found]
    return sorted(findings, key=lambda finding: finding.claim)


def _solved(cell: Cell) -> Finding:
    scores = scores_of(cell, common_episodes(cell))
    found = _above("g", scores.name, scores.final, SOLVED)
    return replace(found, episodes=scores.episodes, remark=_cut(cell))


def _cut(*cells: Cell) -> str:
    """Says what is left out where some seed has fewer episodes than others."""
    episodes, longest = common_episodes(*cells), max(int(cell.lengths.max()) for cell in cells)
    if episodes == longest:
        return ""
    return f"the first {episodes} of {longest} episodes, which every seed has"


def examine_heuristic(task: str, returns: FloatArray) -> Finding:
    """Returns what the (episodes,) returns of a task's hand-written policy say of claim (h)."""
    return _above("h", task, returns, SOLVED)


def findings_frame(findings: Sequence[Finding]) -> pd.DataFrame:
    """Returns a row for each finding: the exact numbers behind the tables.

    Columns: claim (its letter), source, compared, seeds, episodes, effect, low, high (ends of the
    interval: of 90% for claim a, else of 95%), verdict, seeds_needed, remark.
    """
    rows = [
        (
            *(one.claim, one.source, one.compared, one.seeds, one.episodes),
            *(*one.effect[:3], one.verdict, one.seeds_needed, one.remark),
        )
        for one in findings
    ]
    columns = ["claim", "source", "compared", "seeds", "episodes", "effect", "low", "high"]
    frame = pd.DataFrame(rows, columns=[*columns, "verdict", "seeds_needed", "remark"])
    return frame.astype({"episodes": "Int64", "seeds_needed": "Int64"})


def decide(
    effect: st.Estimate, seeds: int, boundary: float, *, logarithmic: bool = False
) -> tuple[Verdict, int | None]:
    """Returns the verdict on a claim that an effect lies above a boundary, and the seeds it needs.

    Args:
        effect: with its 95% interval.
        seeds: of each group.
        boundary: above which the claim holds.
        logarithmic: whether the effect is a ratio, whose distances are those of its logarithm.
    """
    if seeds >= st.DECIDING_SEEDS and effect.low > boundary:
        return "supported", None
    if seeds >= st.DECIDING_SEEDS and effect.high < boundary:
        return "contradicted", None
    distance, error = effect.value - boundary, effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / boundary), error / effect.value
    return "undecided", _at_least(st.seeds_to_decide(distance, error, seeds))


def _at_least(seeds: int | None) -> int | None:
    return None if seeds is None else max(st.DECIDING_SEEDS, seeds)


def decide_similar(
    inner: st.Estimate, outer: st.Estimate, seeds: int
) -> tuple[Verdict, int | None]:
    """Returns the verdict on a claim that two are similar, and the seeds it needs.

    Args:
        inner: the difference with its 90% interval.
        outer: the difference with its 95% interval.
        seeds: of each group.
    """
    if seeds >= st.DECIDING_SEEDS and inner.low > -MARGIN and inner.high < MARGIN:
        return "supported", None
    if seeds >= st.DECIDING_SEEDS and (outer.low > MARGIN or outer.high < -MARGIN):
        return "contradicted", None
    distance = MARGIN - abs(inner.value)
    return "undecided", _at_least(st.seeds_to_decide(distance, inner.standard_error, seeds))


def _of_representation(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Gives (a) to (d): the reduced order against the full observation."""
    pairs = list(_pairs(cells, _reduces))
    for full, reduced in pairs:
        yield from _reduced_findings(full, reduced)
    for harder, easier in ((h, e) for h in pairs for e in pairs if _harder(h[0], e[0])):
        scores = [*_compared(*harder)[::-1], *_compared(*easier)[::-1]]
        effect = st.estimate(_gain_of_gains, *([one.area] for one in scores))
        seeds = min(len(one.area) for one in scores)
        compared = " ".join(filter(None, (harder[0].algo, harder[0].label)))
        yield Finding(
            *("d", f"{compared}: {HARDER} against {EASIER}", effect, seeds),
            *decide(effect, seeds, 0),
            episodes=min(one.episodes for one in scores),
            remark="; ".join(filter(None, (_cut(*harder), _cut(*easier)))),
        )


def _reduced_findings(full: Cell, reduced: Cell) -> Iterator[Finding]:
    theirs, ours = _compared(full, reduced)
    compared = f"{ours.name} against {FULL}"
    seeds = min(len(theirs.final), len(ours.final))
    more: dict[str, Any] = {"episodes": ours.episodes, "remark": _cut(full, reduced)}
    iqm = st.difference(st.interquartile_mean)
    final = [ours.final], [theirs.final]
    inner = st.estimate(iqm, *final, confidence=0.9)
    similar = decide_similar(inner, st.estimate(iqm, *final), seeds)
    yield Finding("a", compared, inner, seeds, *similar, **more)
    spread = st.estimate(st.ratio(st.standard_deviation), *final)
    verdict, needed = decide(spread, seeds, 1.0, logarithmic=True)
    yield Finding("b", compared, spread, seeds, _opposite(verdict), needed, **more)
    faster = st.estimate(iqm, [ours.area], [theirs.area])
    yield Finding("c", compared, faster, seeds, *decide(faster, seeds, 0), **more)


def _of_algorithms(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Gives (e) and (f): off-policy algorithms against PPO."""
    both = algorithm_pairs(cells)
    for ppo, other in (pair if pair[0].algo == ON_POLICY else pair[::-1] for pair in both):
        if ppo.algo != ON_POLICY or other.algo not in OFF_POLICY:
            continue
        theirs, ours = _compared(ppo, other)
        compared = f"{ours.name} against {ON_POLICY}"
        seeds = min(len(theirs.final), len(ours.final))
        more: dict[str, Any] = {"episodes": ours.episodes, "remark": _cut(ppo, other)}
        final = [ours.final], [theirs.final]
        higher = st.estimate(st.difference(st.median), *final)
        yield Finding("e", compared, higher, seeds, *decide(higher, seeds, 0), **more)
        wider = st.estimate(st.ratio(st.standard_deviation), *final)
        verdict = decide(wider, seeds, 1.0, logarithmic=True)
        yield Finding("f", compared, wider, seeds, *verdict, **more)


def _pairs(
    cells: Sequence[Cell], belong: Callable[[Cell, Cell], bool]
) -> Iterator[tuple[Cell, Cell]]:
    return ((one, other) for one in cells for other in cells if belong(one, other))


def _reduces(full: Cell, reduced: Cell) -> bool:
    same = (full.task, full.algo) == (reduced.task, reduced.algo)
    named = (full.representation, reduced.representation) == (FULL, REDUCED)
    return same and named and full.same_but(reduced, "representation")


def _harder(one: Cell, other: Cell) -> bool:
    named = (one.task, other.task) == (HARDER, EASIER)
    return named and one.algo == other.algo and one.same_but(other, "task")


def _compared(one: Cell, other: Cell) -> tuple[Scores, Scores]:
    """Returns the scores of two cells over the episodes that every seed of both has."""
    episodes = common_episodes(one, other)
    return scores_of(one, episodes), scores_of(other, episodes)


def _above(letter: str, compared: str, values: FloatArray, boundary: float) -> Finding:
    effect = st.estimate(st.median, [values])
    return Finding(
        letter, compared, effect, len(values), *decide(effect, len(values), boundary - 1e-9)
    )


def _gain_of_gains(
    harder_reduced: st.Strata,
    harder_full: st.Strata,
    easier_reduced: st.Strata,
    easier_full: st.Strata,
) -> FloatArray:
    iqm = st.interquartile_mean
    return iqm(harder_reduced) - iqm(harder_full) - (iqm(easier_reduced) - iqm(easier_full))


def _opposite(verdict: Verdict) -> Verdict:
    swapped: dict[Verdict, Verdict] = {"supported": "contradicted", "contradicted": "supported"}
    return swapped.get(verdict, verdict)
