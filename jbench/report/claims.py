"""The paper's claims, each with the comparison that tests it, stated before looking at data.

A claim is tested on every pair of cells that it speaks of. The statistic, the value that would
refute it and the margin are fixed here, in code, and are the same for our runs and for the
published curves.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from jbench.names import FULL
from jbench.report import statistics as st
from jbench.report.cells import Cell
from jbench.report.curves import FloatArray, final_returns
from jbench.report.drawing import SOLVED

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


class Scores(NamedTuple):
    """What the seeds of a cell came to, up to the same control step as those compared with it.

    Attributes:
        task: what was learned.
        algo: by which algorithm.
        representation: `full`, or an encoder's kind and size.
        final: (seeds,) mean return at the end.
        area: (seeds,) mean return over all episodes.
    """

    task: str
    algo: str
    representation: str
    final: FloatArray
    area: FloatArray

    @property
    def name(self) -> str:
        """Names the cell for a reader."""
        return f"{self.task} {self.algo} {self.representation}"


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
        source: `ours`, or the figure of the paper.
    """

    claim: str
    compared: str
    effect: st.Estimate
    seeds: int
    verdict: Verdict
    seeds_needed: int | None
    source: str = "ours"


def scores_of(cell: Cell, episodes: int) -> Scores:
    """Returns the scores of a cell from its first so many episodes."""
    returns, steps = cell.returns[:, :episodes], cell.control_steps[:, :episodes]
    lengths = np.minimum(cell.lengths, episodes)
    final = final_returns(returns, steps, lengths)[0]
    with np.errstate(invalid="ignore"):
        area = np.nansum(returns, axis=1) / np.isfinite(returns).sum(axis=1)
    known = np.isfinite(final) & np.isfinite(area)
    return Scores(cell.task, cell.algo, cell.representation, final[known], area[known])


def examine(cells: Sequence[Cell]) -> list[Finding]:
    """Returns what our runs say of the claims (a) to (g), in their order.

    Cells are compared where both are on the plain robot and differ in nothing else than the claim
    speaks of; each pair is cut to the episodes that every seed of both has.
    """
    plain = [cell for cell in cells if not cell.robots]
    findings = [*_of_representation(plain), *_of_algorithms(plain)]
    for cell in plain:
        scores = scores_of(cell, int(cell.lengths.min()))
        findings.append(_above("g", scores.name, scores.final, SOLVED))
    return sorted(findings, key=lambda finding: finding.claim)


def examine_heuristic(task: str, returns: FloatArray) -> Finding:
    """Returns what the (episodes,) returns of a task's hand-written policy say of claim (h)."""
    return _above("h", task, returns, SOLVED)


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
    if effect.low > boundary:
        return "supported", None
    if effect.high < boundary:
        return "contradicted", None
    distance, error = effect.value - boundary, effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / boundary), error / effect.value
    return "undecided", st.seeds_to_decide(distance, error, seeds)


def decide_similar(
    inner: st.Estimate, outer: st.Estimate, seeds: int
) -> tuple[Verdict, int | None]:
    """Returns the verdict on a claim that two are similar, and the seeds it needs.

    Args:
        inner: the difference with its 90% interval.
        outer: the difference with its 95% interval.
        seeds: of each group.
    """
    if inner.low > -MARGIN and inner.high < MARGIN:
        return "supported", None
    if outer.low > MARGIN or outer.high < -MARGIN:
        return "contradicted", None
    distance = MARGIN - abs(inner.value)
    return "undecided", st.seeds_to_decide(distance, inner.standard_error, seeds)


def _of_representation(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Gives (a) to (d): the reduced order against the full observation."""
    gains: dict[tuple[str, str], tuple[Scores, Scores]] = {}
    for full, reduced in _pairs(cells, lambda one, other: _reduces(one, other)):
        pair = _compared(full, reduced)
        gains[full.task, full.algo] = pair
        yield from _reduced_findings(*pair)
    for (task, algo), harder in gains.items():
        easier = gains.get((EASIER, algo))
        if task == HARDER and easier is not None:
            groups = [[scores.area] for scores in (*harder[::-1], *easier[::-1])]
            effect = st.estimate(_gain_of_gains, *groups)
            seeds = min(len(scores.area) for scores in (*harder, *easier))
            yield Finding(
                "d", f"{algo}: {HARDER}, {EASIER}", effect, seeds, *decide(effect, seeds, 0)
            )


def _reduced_findings(full: Scores, reduced: Scores) -> Iterator[Finding]:
    compared = f"{reduced.name} against {FULL}"
    seeds = min(len(full.final), len(reduced.final))
    iqm = st.difference(st.interquartile_mean)
    final = [reduced.final], [full.final]
    inner = st.estimate(iqm, *final, confidence=0.9)
    similar = decide_similar(inner, st.estimate(iqm, *final), seeds)
    yield Finding("a", compared, inner, seeds, *similar)
    spread = st.estimate(st.ratio(st.standard_deviation), *final)
    verdict, needed = decide(spread, seeds, 1.0, logarithmic=True)
    yield Finding("b", compared, spread, seeds, _opposite(verdict), needed)
    faster = st.estimate(iqm, [reduced.area], [full.area])
    yield Finding("c", compared, faster, seeds, *decide(faster, seeds, 0))


def _of_algorithms(cells: Sequence[Cell]) -> Iterator[Finding]:
    """Gives (e) and (f): off-policy algorithms against PPO."""
    for ppo, other in _pairs(cells, lambda one, two: _off_policy(one, two)):
        theirs, ours = _compared(ppo, other)
        compared = f"{ours.name} against {ON_POLICY}"
        seeds = min(len(theirs.final), len(ours.final))
        higher = st.estimate(st.difference(st.median), [ours.final], [theirs.final])
        yield Finding("e", compared, higher, seeds, *decide(higher, seeds, 0))
        wider = st.estimate(st.ratio(st.standard_deviation), [ours.final], [theirs.final])
        verdict = decide(wider, seeds, 1.0, logarithmic=True)
        yield Finding("f", compared, wider, seeds, *verdict)


def _pairs(
    cells: Sequence[Cell], belong: Callable[[Cell, Cell], bool]
) -> Iterator[tuple[Cell, Cell]]:
    return ((one, other) for one in cells for other in cells if belong(one, other))


def _reduces(full: Cell, reduced: Cell) -> bool:
    same = (full.task, full.algo, full.label) == (reduced.task, reduced.algo, reduced.label)
    return same and (full.representation, reduced.representation) == (FULL, REDUCED)


def _off_policy(ppo: Cell, other: Cell) -> bool:
    same = (ppo.task, ppo.representation) == (other.task, other.representation)
    return same and ppo.algo == ON_POLICY and other.algo in OFF_POLICY


def _compared(one: Cell, other: Cell) -> tuple[Scores, Scores]:
    """Returns the scores of two cells over the episodes that every seed of both has."""
    episodes = int(min(one.lengths.min(), other.lengths.min()))
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
