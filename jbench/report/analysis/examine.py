"""Tests the paper's claims on every pair of configurations."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from jbench.names import FULL
from jbench.report.analysis.claims import MARGIN, UNDECIDED, Row, decide, decide_solved
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, Scores, seed_scores
from jbench.report.data.configuration import Configuration, differing_in
from jbench.report.data.returns import EVALUATION, rounded, steps
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st

_REDUCED = "dae12"  # the paper's reduced order: 12 latents of a denoising autoencoder
_OFF_POLICY, _ON_POLICY = ("ddpg", "sac", "td3"), "ppo"
_HARDER, _EASIER = "move_in_direction", "face_direction"  # the tasks of Figures 8 and 7
# Median return of random actions in 100 episodes (`jbench evaluate random`).
_RANDOM_RETURNS = {_EASIER: 220.0, _HARDER: 303.0}

_STATISTICS = {
    "a": (IQM_DIFFERENCE, "final"),
    "b": (st.ratio(st.standard_deviation), "final"),
    "c": (IQM_DIFFERENCE, "area"),
    "e": (st.difference(st.median), "final"),
    "f": (st.ratio(st.standard_deviation), "final"),
}  # of each claim on two configurations, and the scores of which it is


def examine(configurations: Sequence[Configuration]) -> Iterator[Row]:
    """Yields findings on the claims (a) to (g), from configurations of one kind of return.

    Two of them are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about.
    """
    plain = [config for config in configurations if not config.robots]
    reduced = [
        Pair(ours, full)
        for group in differing_in(plain, "representation")
        for full, ours in product(group, repeat=2)
        if (full.representation, ours.representation) == (FULL, _REDUCED)
    ]
    for pair in reduced:
        yield from (_on_pair(claim, pair, FULL) for claim in "abc")
    for harder, easier in product(reduced, repeat=2):
        full = harder.theirs, easier.theirs
        named = (full[0].task, full[1].task) == (_HARDER, _EASIER)
        if named and differing_in(full, "task"):
            yield _on_gain(harder, easier)
    for group in differing_in(plain, "algo"):
        firsts = {config.algo: config for config in reversed(group)}
        for other, ppo in product(group, repeat=2):
            named = other.algo in _OFF_POLICY and ppo.algo == _ON_POLICY
            # Two variants are compared only with the first one of the other algorithm.
            if named and (other is firsts[other.algo] or ppo is firsts[ppo.algo]):
                yield from (_on_pair(claim, Pair(other, ppo), _ON_POLICY) for claim in "ef")
    for config in plain:
        if config.has_solved_return:
            final = seed_scores(config, int(config.last_step)).final
            yield examine_solving("g", config.name, final) | _common(config)


def examine_solving(claim: str, compared: str, returns: FloatArray) -> Row:
    """Returns the finding on (g) from final returns (seeds,), or on (h) from those of episodes."""
    effect, count = st.estimate(st.median, [returns]), len(returns)
    row = _finding(claim, compared, effect, count) | {"returns": EVALUATION}
    return row | decide_solved(effect, count)


def _finding(claim: str, compared: str, effect: st.Estimate, seeds: int) -> Row:
    row: Row = {"claim": claim, "compared": compared, "seeds": seeds}
    return row | {"effect": effect.value, "low": effect.low, "high": effect.high}


def _common(*compared: Configuration) -> Row:
    """Returns some columns, with a remark if some seeds have fewer control steps than others."""
    common = min(config.last_step for config in compared)
    longest = max(config.longest for config in compared)
    reached = f"at {steps(common)} of {steps(longest)} control steps, the last that every seed has"
    row = {"returns": compared[0].kind, "source": compared[0].source, "steps": int(common)}
    return row | {"remark": "" if common == longest else reached}


def _on_pair(claim: str, pair: Pair, baseline: str) -> Row:
    sample = pair.sample(*_STATISTICS[claim])
    effect = outer = sample.estimate()
    low, high = (1.0, np.inf) if claim in "bf" else (0.0, np.inf)
    if claim == "a":  # two one-sided tests at 5%
        effect, low, high = sample.estimate(0.9), -MARGIN, MARGIN
    decided = decide(effect, pair.seeds, low, high, outer=outer, logarithmic=claim in "bf")
    row = _finding(claim, f"{pair.ours.name} against {baseline}", effect, pair.seeds)
    row |= _common(*pair.sides) | decided
    return row | _without_episodes(row, pair) if claim in "bf" else row


def _without_episodes(row: Row, pair: Pair) -> Row:
    """Returns the verdict on a ratio, undecided if the variation of episodes may explain it.

    Claim (b) is that the first agents vary less, (f) that they vary more. Column by_episodes: the
    effect that episodes alone would cause if all agents of a configuration had the same expected
    return; NaN if it is unknown.
    """
    verdict, remark = row["verdict"], row["remark"]
    value, low, high, _ = pair.agents_difference()
    if not {"supported": low > 0, "contradicted": high < 0}.get(verdict, True):
        interval = f"difference {rounded(value)} [{rounded(low)}, {rounded(high)}]"
        reason = f"of the agents alone: {interval if np.isfinite(value) else 'unknown'}"
        verdict, remark = "undecided", "; ".join(filter(None, (reason, remark)))
    if row["claim"] == "b":
        verdict = {"supported": "contradicted", "contradicted": "supported"}.get(verdict, verdict)
    ours, theirs = (side.deviation_by_episodes for side in pair.scores)
    by_episodes = ours / theirs if theirs > 0 else np.nan
    return {"verdict": verdict, "remark": remark, "by_episodes": by_episodes}


def _on_gain(harder: Pair, easier: Pair) -> Row:
    scores = [*harder.scores, *easier.scores]
    effect = st.estimate(
        lambda *areas: IQM_DIFFERENCE(*areas[:2]) - IQM_DIFFERENCE(*areas[2:]),
        *([side.area] for side in scores),
    )
    seeds, first = min(harder.seeds, easier.seeds), harder.theirs
    untested = _no_gain_to_compare(scores)
    name = ", ".join(filter(None, (first.algo, first.words)))
    common, other = (_common(*pair.sides) for pair in (harder, easier))
    row = _finding("d", f"{name}: {_HARDER} against {_EASIER}", effect, seeds) | common
    row["steps"] = min(harder.control_steps, easier.control_steps)
    row["remark"] = "; ".join(filter(None, (untested, common["remark"], other["remark"])))
    return row | (UNDECIDED if untested else decide(effect, seeds, 0))


def _no_gain_to_compare(scores: Sequence[Scores]) -> str:
    """Returns why gains test nothing on claim (d); else an empty text.

    Scores are of the harder task's reduced order and full observation, then of the easier task's.
    """
    for task, pair in ((_HARDER, scores[:2]), (_EASIER, scores[2:])):
        random = _RANDOM_RETURNS[task]
        if all(abs(np.median(side.final) - random) <= MARGIN for side in pair if len(side.final)):
            near = f"both are within {MARGIN:g} of random actions ({random:g})"
            return f"no verdict, on {task} {near}"
    gain = float(IQM_DIFFERENCE([scores[0].area], [scores[1].area]))
    return "" if gain > 0 else f"no verdict, nothing is gained on {_HARDER} ({rounded(gain)})"
