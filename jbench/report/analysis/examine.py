"""Tests the paper's claims on every pair of configurations."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from jbench.names import FULL
from jbench.report.analysis import claims
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, PairedScores, Scores, seed_scores
from jbench.report.data.configuration import Configuration, differing_in
from jbench.report.data.returns import EVALUATION, steps
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st

_OPPOSITE = {"supported": "contradicted", "contradicted": "supported"}
_STATISTICS = {
    "a": (IQM_DIFFERENCE, "final"),
    "b": (st.ratio(st.standard_deviation), "final"),
    "c": (IQM_DIFFERENCE, "area"),
    "e": (st.difference(st.median), "final"),
    "f": (st.ratio(st.standard_deviation), "final"),
}
"""Statistic of each claim on two configurations, and the scores of which it is."""


def examine(configurations: Sequence[Configuration]) -> Iterator[claims.Row]:
    """Yields findings on the claims (a) to (g), from configurations of one kind of return.

    Two of them are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about; each pair at the last control step that every seed of both has reached.
    """
    plain = [config for config in configurations if not config.robots]
    reduced = [
        (ours, full)
        for group in differing_in(plain, "representation")
        for full in group
        for ours in group
        if (full.representation, ours.representation) == (FULL, claims.REDUCED)
    ]
    for pair in reduced:
        yield from _on_pair("abc", pair, FULL)
    for harder, easier in product(reduced, repeat=2):
        full, other = harder[1], easier[1]
        named = (full.task, other.task) == (claims.HARDER, claims.EASIER)
        if named and full.comparable("task") == other.comparable("task"):
            yield _on_gain(harder, easier)
    for pair in _off_policy(plain):
        yield from _on_pair("ef", pair, claims.ON_POLICY)
    for config in plain:
        if config.has_solved_return:
            final = seed_scores(config, int(config.last_step)).final
            yield _on_solving("g", config.name, final, **_common(config))


def _off_policy(plain: Sequence[Configuration]) -> Iterator[Pair]:
    """Yields the pairs of an off-policy algorithm and PPO.

    If both have variants, each is only compared with the first variant of the other algorithm.
    """
    for group in differing_in(plain, "algo"):
        firsts = {config.algo: config for config in reversed(group)}
        for other in (config for config in group if config.algo in claims.OFF_POLICY):
            for ppo in (config for config in group if config.algo == claims.ON_POLICY):
                if other is firsts[other.algo] or ppo is firsts[claims.ON_POLICY]:
                    yield other, ppo


def examine_heuristic(task: str, returns: FloatArray) -> claims.Row:
    """Returns the finding on claim (h) from returns (episodes,) of a task's hand-written policy."""
    return _on_solving("h", task, returns, returns=EVALUATION)


def _on_solving(claim: str, compared: str, values: FloatArray, **more: Any) -> claims.Row:
    effect, count = st.estimate(st.median, [values]), len(values)
    return claims.finding(
        claim, compared, effect, count, claims.decide_solved(effect, count), **more
    )


def _common(*compared: Configuration) -> claims.Row:
    """Returns the columns that all findings on the same configurations share."""
    more = {"steps": int(min(config.last_step for config in compared)), "remark": _cut(compared)}
    return {"returns": compared[0].kind, "source": compared[0].source, **more}


def _cut(compared: Iterable[Configuration]) -> str:
    """Returns a remark if some seeds have fewer control steps than others; else an empty text."""
    common, longest = zip(*((config.last_step, config.longest) for config in compared), strict=True)
    if min(common) == max(longest):
        return ""
    reached = f"at {steps(min(common))} of {steps(max(longest))} control steps"
    return f"{reached}, the last that every seed has"


def _on_pair(letters: str, pair: Pair, baseline: str) -> Iterator[claims.Row]:
    """Yields the findings on some claims, each that the first differs from the second."""
    scores = PairedScores(*pair)
    for claim in letters:
        sample, more = scores.sample(*_STATISTICS[claim]), _common(*pair)
        effect = sample.estimate()
        if claim == "a":
            outer, effect = effect, sample.estimate(0.9)
            decided = claims.decide_similar(effect, outer, scores.seeds)
        else:
            width = claim in "bf"
            decided = claims.decide(effect, scores.seeds, float(width), logarithmic=width)
            if width:
                decided, more = _without_episodes(claim, scores, decided, more)
        compared = f"{pair[0].name} against {baseline}"
        yield claims.finding(claim, compared, effect, scores.seeds, decided, **more)


def _without_episodes(
    claim: str, scores: PairedScores, decided: claims.Row, more: claims.Row
) -> tuple[claims.Row, claims.Row]:
    """Returns the verdict on a ratio, undecided if the variation of episodes may explain it.

    Claim (b) is that the first agents vary less, (f) that they vary more.

    Args:
        more: other columns of the finding, which are returned with by_episodes and the reason.
    """
    verdict = decided["verdict"]
    deviations = (side.deviation_by_episodes for side in (scores.ours, scores.theirs))
    more = {**more, "by_episodes": claims.ratio_of_widths(*deviations)}
    value, low, high, _ = scores.agents_difference()
    if not {"supported": low > 0, "contradicted": high < 0}.get(verdict, True):
        interval = f"difference {value:+.0f} [{low:+.0f}, {high:+.0f}]"
        reason = f"of the agents alone: {interval if np.isfinite(value) else 'unknown'}"
        verdict = "undecided"
        more["remark"] = "; ".join(filter(None, (reason, more["remark"])))
    return decided | {"verdict": _OPPOSITE.get(verdict, verdict) if claim == "b" else verdict}, more


def _on_gain(harder: Pair, easier: Pair) -> claims.Row:
    pairs = PairedScores(*harder), PairedScores(*easier)
    scores = [side for pair in pairs for side in (pair.ours, pair.theirs)]
    effect = st.estimate(_gain_of_gains, *([side.area] for side in scores))
    seeds = min(pair.seeds for pair in pairs)
    untested = _no_gain_to_compare(scores)
    decided = claims.UNDECIDED if untested else claims.decide(effect, seeds, 0)
    more = _common(*harder) | {"steps": min(side.control_steps for side in scores)}
    more["remark"] = "; ".join(filter(None, (untested, _cut(harder), _cut(easier))))
    name = ", ".join(filter(None, (harder[1].algo, harder[1].words)))
    return claims.finding(
        "d", f"{name}: {claims.HARDER} against {claims.EASIER}", effect, seeds, decided, **more
    )


def _no_gain_to_compare(scores: Sequence[Scores]) -> str:
    """Returns why gains test nothing on claim (d); else an empty text.

    Args:
        scores: of the harder task's reduced order and full observation, then of the easier task's.
    """
    for task, pair in ((claims.HARDER, scores[:2]), (claims.EASIER, scores[2:])):
        random = claims.RANDOM_RETURNS[task]
        if all(
            abs(np.median(side.final) - random) <= claims.MARGIN for side in pair if len(side.final)
        ):
            near = f"both are within {claims.MARGIN:g} of random actions ({random:g})"
            return f"no verdict, on {task} {near}"
    gain = IQM_DIFFERENCE([scores[0].area], [scores[1].area])
    return "" if gain > 0 else f"no verdict, nothing is gained on {claims.HARDER} ({gain:+.0f})"


def _gain_of_gains(*strata: st.Strata) -> FloatArray:
    return IQM_DIFFERENCE(*strata[:2]) - IQM_DIFFERENCE(*strata[2:])
