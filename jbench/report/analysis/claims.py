"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of configurations to which it applies. The statistic, the value that
would refute it and the margin are the same for our runs, for the published curves, and for both
kinds of return.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from jbench.array_types import FloatArray
from jbench.numbers import signed, steps, whole, with_interval
from jbench.report.analysis.baselines import baseline_pairs
from jbench.report.analysis.decisions import Study
from jbench.report.analysis.findings import (
    FASTER,
    GAINS_MORE,
    OFF_POLICY_HIGHER,
    OFF_POLICY_VARIES_MORE,
    SIMILAR_RETURN,
    SOLVED,
    VARIES_LESS,
    ClaimVerdict,
    Finding,
    claim_verdict,
    solved_verdict,
)
from jbench.report.analysis.pair import IQM_DIFFERENCE, Pair
from jbench.report.analysis.schedules import remark_on_schedules
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import Configuration, differing_in
from jbench.report.data.scores import Scores
from jbench.report.data.untrained import random_return
from jbench.representation_names import FULL, REPRESENTATION, kind_in
from jbench.settings.algorithms import display_name
from jbench.settings.recorded import comparable
from jbench.statistics import bootstrap as st
from jbench.statistics.verdicts import ERROR_RATE
from jbench.studies.quantities import FINAL_RETURN, MARGIN, SPEED
from jbench.studies.study import RAW
from jbench.wording import joined_clauses

_OFF_POLICY = ("ddpg", "sac", "td3")
_ON_POLICY = "ppo"
_HARDER = "move_in_direction"  # the task of Figure 8
_EASIER = "face_direction"  # that of Figure 7


@dataclass(frozen=True)
class _PairTest:
    """How a claim on two configurations is tested.

    Attributes:
        statistic: of the scores of both.
        scores: which ones, `final` or `area`; see `Scores`.
        is_ratio: whether the statistic is a ratio, in place of a difference.
    """

    statistic: st.Statistic
    scores: str
    is_ratio: bool = False


_RATIO_OF_DEVIATIONS = _PairTest(st.ratio(st.standard_deviation), "final", is_ratio=True)

_PAIR_TESTS = {
    SIMILAR_RETURN: _PairTest(IQM_DIFFERENCE, "final"),
    VARIES_LESS: _RATIO_OF_DEVIATIONS,
    FASTER: _PairTest(IQM_DIFFERENCE, "area"),
    OFF_POLICY_HIGHER: _PairTest(st.difference(st.median), "final"),
    OFF_POLICY_VARIES_MORE: _RATIO_OF_DEVIATIONS,
}
"""By claim."""

_NO_MARGIN = "no verdict, nothing says which returns of the task are similar: type --margin"


def examine(
    configurations: Sequence[Configuration], studies: Sequence[Study] = ()
) -> Iterator[Finding]:
    """Yields findings on all claims on agents, from configurations of one kind of return.

    Two of them are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about. The full observation is that of the task (`full`), or as a study names
    it, in SI units (`raw`).
    """
    plain = [config for config in configurations if not config.robots]
    reduced = [
        pair
        for pair in baseline_pairs(plain, studies)
        if _is_reduced(pair.ours.representation)
        and kind_in(pair.theirs.representation) in (FULL, RAW)
    ]
    for pair in reduced:
        for claim in (SIMILAR_RETURN, VARIES_LESS, FASTER):
            yield _on_pair(claim, pair, kind_in(pair.theirs.representation))

    for harder, easier in product(reduced, repeat=2):
        if _differ_in_task(harder, easier):
            yield _on_gain(harder, easier)

    for group in differing_in(plain, "algo"):
        firsts = {config.algo: config for config in reversed(group)}
        for other, ppo in product(group, repeat=2):
            named = other.algo in _OFF_POLICY and ppo.algo == _ON_POLICY
            # Two variants are compared only with the first one of the other algorithm.
            if named and (other is firsts[other.algo] or ppo is firsts[ppo.algo]):
                for claim in (OFF_POLICY_HIGHER, OFF_POLICY_VARIES_MORE):
                    yield _on_pair(claim, Pair(other, ppo), display_name(_ON_POLICY))

    for config in plain:
        if config.has_solved_return:
            final = seed_scores(config, int(config.last_step)).final
            returns, source, at, remark = _common(config)
            finding = examine_solving(SOLVED, config.name, final)
            yield replace(finding, returns=returns, source=source, steps=at, remark=remark)


def examine_solving(claim: str, compared: str, returns: FloatArray) -> Finding:
    """Returns the finding on a solved task, from final returns (seeds,) or those of episodes."""
    effect = st.estimate(st.median, [returns])
    count = len(returns)
    return Finding(claim, compared, effect, count, solved_verdict(effect, count))


def _is_reduced(representation: str) -> bool:
    """Returns whether this is the paper's reduced order: 12 latents of a denoising autoencoder.

    Its features and its training may be any; its latents are as the encoder makes them.
    """
    match = REPRESENTATION.fullmatch(representation)
    return (
        match is not None
        and (match["kind"], match["latents"]) == ("dae", "12")
        and not (match["scale"] or match["rescale"])
    )


def _differ_in_task(harder: Pair, easier: Pair) -> bool:
    """Returns whether two pairs of the harder and the easier task have equal settings and design.

    The features of the observation follow from the task; a design is one encoder for all agents,
    or one for each.
    """
    settings = [side.settings for side in (harder.theirs, easier.theirs)]
    draws = [getattr(pair.ours.settings, "encoder_draws", None) for pair in (harder, easier)]
    kinds = {kind_in(pair.theirs.representation) for pair in (harder, easier)}
    first, other = (comparable(run, "task", "representation") for run in settings)
    return (
        (harder.theirs.task, easier.theirs.task) == (_HARDER, _EASIER)
        and harder.theirs.source == easier.theirs.source
        and first == other
        and len(kinds) == 1
        and (draws[0] is None) == (draws[1] is None)
    )


def _common(*compared: Configuration) -> tuple[str, str, int, str]:
    """Returns kind of return, source, control steps, and a remark if some seeds have fewer."""
    common = min(config.last_step for config in compared)
    longest = max(config.longest for config in compared)
    reached = f"at {steps(common)} of {steps(longest)} control steps, the last that every seed has"
    first = compared[0]
    return first.returns_name, first.source, int(common), "" if common == longest else reached


def _on_pair(claim: str, pair: Pair, baseline: str) -> Finding:
    """Tests a claim on the returns of a reduced representation and of its baseline."""
    test = _PAIR_TESTS[claim]
    sample = pair.sample(test.statistic, test.scores)
    contradicting = sample.estimate()
    supporting = contradicting
    low = 1.0 if test.is_ratio else 0.0
    high = np.inf
    if claim == SIMILAR_RETURN:  # two one-sided tests at 5%
        supporting = sample.estimate(0.9)
        high = pair.ours.margin
        low = -high

    decided = claim_verdict(
        supporting, pair.seeds, low, high, outer=contradicting, logarithmic=test.is_ratio
    )
    returns, source, at, remark = _common(*pair.sides)
    quantity = SPEED if claim == FASTER else FINAL_RETURN
    remark = joined_clauses(remark, remark_on_schedules(pair, quantity))
    if claim == SIMILAR_RETURN and not pair.ours.margin:
        decided = ClaimVerdict()
        remark = joined_clauses(_NO_MARGIN, remark)

    finding = Finding(
        claim=claim,
        compared=f"{pair.ours.name} against {baseline}",
        effect=supporting,
        seeds=pair.seeds,
        decided=decided,
        returns=returns,
        source=source,
        steps=at,
        remark=remark,
    )
    return _without_episodes(finding, pair) if test.is_ratio else finding


def _without_episodes(finding: Finding, pair: Pair) -> Finding:
    """Returns a finding on a ratio, undecided if episodes or a few failed agents may explain it.

    The effect is how much more the first agents vary; a claim may be that they vary less.
    """
    decided = finding.decided
    remark = finding.remark
    evidence = pair.variability()
    value, low, high, _ = evidence.estimate(0.95)
    reason = ""
    if not {"supported": low > 0, "contradicted": high < 0}.get(decided.verdict, True):
        interval = f"difference {with_interval(signed, value, (low, high))}"
        alone = interval if np.isfinite(value) else f"unknown, {pair.unknown_variability}"
        reason = f"of the agents alone: {alone}"
    elif decided.verdict != "undecided":
        p_value = evidence.p_value(0.0)
        if p_value > ERROR_RATE:
            reason = f"not confirmed by a permutation test: p = {p_value:.2g}"
    elif np.isnan(finding.effect.value) and pair.seeds:
        reason = "unknown, since the returns of neither side vary"

    if reason:
        decided = replace(decided, verdict="undecided")
        remark = joined_clauses(reason, remark)

    if finding.claim == VARIES_LESS:
        opposite = {"supported": "contradicted", "contradicted": "supported"}
        decided = replace(decided, verdict=opposite.get(decided.verdict, decided.verdict))

    ours, theirs = (side.deviation_by_episodes for side in pair.scores)
    by_episodes = ours / theirs if theirs > 0 else np.nan
    return replace(finding, decided=decided, remark=remark, by_episodes=by_episodes)


def _on_gain(harder: Pair, easier: Pair) -> Finding:
    """Tests whether reduction gains more on the harder of two tasks, up to one control step."""
    end = min(harder.control_steps, easier.control_steps)
    harder = harder.up_to(end)
    easier = easier.up_to(end)
    scores = [*harder.scores, *easier.scores]
    effect = st.estimate(
        lambda *areas: IQM_DIFFERENCE(*areas[:2]) - IQM_DIFFERENCE(*areas[2:]),
        *([side.area] for side in scores),
    )
    seeds = min(harder.seeds, easier.seeds)
    untested = _no_gain_to_compare(scores)
    words = ", ".join(filter(None, (display_name(harder.ours.algo), harder.ours.words)))
    returns, source, at, remark = _common(*harder.sides, *easier.sides)

    return Finding(
        claim=GAINS_MORE,
        compared=f"{words}: {_HARDER} against {_EASIER}",
        effect=effect,
        seeds=seeds,
        decided=ClaimVerdict() if untested else claim_verdict(effect, seeds, 0),
        returns=returns,
        source=source,
        steps=at,
        remark=joined_clauses(untested, remark),
    )


def _no_gain_to_compare(scores: Sequence[Scores]) -> str:
    """Returns why gains on two tasks test nothing; else an empty text.

    Scores are of the harder task's reduced order and full observation, then of the easier task's.
    """
    if not all(len(side.final) for side in scores):
        return "no verdict, some agents have no finite return"

    for task, pair in ((_HARDER, scores[:2]), (_EASIER, scores[2:])):
        random = random_return(task)
        if all(abs(np.median(side.final) - random) <= MARGIN for side in pair):
            near = f"both are within {MARGIN:g} of random actions ({whole(random)})"
            return f"no verdict, on {task} {near}"
    gain = float(IQM_DIFFERENCE([scores[0].area], [scores[1].area]))
    return "" if gain > 0 else f"no verdict, nothing is gained on {_HARDER} ({signed(gain)})"
