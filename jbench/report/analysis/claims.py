"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of configurations to which it applies. The statistic, the value that
would refute it and the margin are the same for our runs, for the published curves, and for both
kinds of return.

A finding is a row with the claim's letter, what is compared, the effect (the claim's statistic with
the deciding interval), the number of seeds, and the columns of `decide`.
"""

from collections.abc import Iterable, Iterator, Sequence
from importlib import resources
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, Scores, seed_scores
from jbench.report.data.configuration import OWN, Configuration, differing_in
from jbench.report.data.returns import EVALUATION, SOLVED, ratio, rounded, signed, steps, whole
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.statistics.agents import seeds_to_decide
from jbench.studies.deciding import MARGIN

COLUMNS = [
    *("claim", "statement", "test", "source", "returns", "compared", "seeds", "steps"),
    *("effect", "low", "high", "by_episodes", "verdict", "seeds_needed", "seeds_needed_by"),
    *("remark", "text"),
]

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

Row = dict[str, Any]  # columns of a row of `claim_frame`
UNDECIDED: Row = {"verdict": "undecided", "seeds_needed": None, "seeds_needed_by": ""}


def paper_claims() -> pd.DataFrame:
    """Returns the statement and the test of each claim, with its letter as index."""
    file = resources.files("jbench.paper").joinpath("claims.csv")
    return pd.read_csv(str(file), index_col="claim")


def claim_frame(findings: Iterable[dict[Any, Any]]) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper, in the order of the claims."""
    usual: Row = {"source": OWN, "by_episodes": np.nan, "remark": ""} | UNDECIDED
    claims = paper_claims()
    rows = [usual | claims.loc[finding["claim"]].to_dict() | finding for finding in findings]
    for row in rows:
        form = ratio if row["claim"] in "bf" else whole if row["claim"] in "gh" else signed
        value, *ends = (row[name] for name in ("effect", "low", "high"))
        interval = f" [{', '.join(map(form, ends))}]" if np.isfinite(ends).all() else ""
        known = "unknown" if np.isnan(value) else form(value)
        row["text"] = f"{row['verdict']}: {known}{interval}"
    rows.sort(key=lambda row: str(row["claim"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64", "seeds_needed": "Int64"})


def published_findings(task: str | None, algo: str | None) -> list[dict[Any, Any]]:
    """Returns the findings on the paper's curves of a task and an algorithm; None: of all.

    With ten seeds, the band from the 10th to the 90th percentile is an interval of the median
    (`docs/claims.md`); the uncertainty of a band's width is unknown. Returns at the end of training
    are compared; for (c) and (d), the mean of the median over training.
    """
    file = resources.files("jbench.paper").joinpath("published_claims.csv")
    rows = pd.read_csv(str(file), keep_default_na=False, na_values={"low": "", "high": ""})
    for name, value in (("task", task), ("algo", algo)):
        rows = rows if value is None else rows[rows[name] == value]
    return rows.to_dict("records")


def decide(
    effect: st.Estimate,
    seeds: int,
    low: float = -np.inf,
    high: float = np.inf,
    *,
    outer: st.Estimate | None = None,
    logarithmic: bool = False,
) -> Row:
    """Returns the verdict on a claim that an effect is between two numbers, and the seeds needed.

    Columns: verdict (supported, contradicted, undecided), seeds_needed (per configuration, if the
    effect is as now estimated; None if it is decided or no number is known) and seeds_needed_by: a
    power of 80%, or the rule that fewer than six decide nothing.

    Args:
        effect: with the interval that supports the claim.
        outer: the effect with the interval that contradicts it, if it is another one.
        logarithmic: whether the effect is a ratio, whose distance from `low` is logarithmic.
    """
    against = outer or effect
    if seeds >= st.DECIDING_SEEDS:
        if effect.low > low and (effect.high < high or np.isinf(high)):
            return UNDECIDED | {"verdict": "supported"}
        if against.high < low or against.low > high:
            return UNDECIDED | {"verdict": "contradicted"}
    distance, error = min(effect.value - low, high - effect.value), effect.standard_error
    if logarithmic and effect.value > 0:
        distance, error = np.log(effect.value / low), error / effect.value
    needed = seeds_to_decide(distance, error, seeds)
    if needed is None:
        return UNDECIDED
    rule = "80% power"
    if seeds < st.DECIDING_SEEDS and needed <= st.DECIDING_SEEDS:
        needed, rule = st.DECIDING_SEEDS, "six-seed rule"
    return UNDECIDED | {"seeds_needed": needed, "seeds_needed_by": rule}


def decide_solved(median: st.Estimate, seeds: int) -> Row:
    """Returns the verdict on a median return of `SOLVED` or more; see `decide`."""
    return decide(median, seeds, SOLVED - 1e-9)  # a median of exactly 900 solves a task


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
        named = (harder.theirs.task, easier.theirs.task) == (_HARDER, _EASIER)
        if named and differing_in([harder.theirs, easier.theirs], "task"):
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
