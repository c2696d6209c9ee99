"""Tests the paper's claims on every pair of configurations, and on its own curves.

The paper's curves give only medians and bands. With ten seeds, the band from the 10th to the 90th
percentile covers the second to the ninth of them (numpy's linear method puts the 10th percentile
between the first and the second). It therefore contains the population median with a probability of
1 - 22/1024 = 97.9% for any distribution, and serves as a confidence interval of the median. If two
such bands do not overlap, the order of the medians is known with 95.7%. A quartile band covers the
fourth to the seventh seed: 65.6%, too little for a verdict. The uncertainty of a band's width is
unknown.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL
from jbench.report.analysis.claims import (
    EASIER,
    HARDER,
    MARGIN,
    OFF_POLICY,
    ON_POLICY,
    RANDOM_RETURNS,
    REDUCED,
    Finding,
    Verdict,
    decide,
    decide_similar,
    decide_solved,
)
from jbench.report.analysis.scores import IQM_DIFFERENCE, Comparison, Pair, Scores, seed_scores
from jbench.report.data.configuration import Configuration, differing_in
from jbench.report.data.published import CURVE
from jbench.report.data.returns import EVALUATION, TRAINING, steps
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st

_BAND = "the interval is the 10-90 band, which contains the population median with 97.9%"
_NO_WIDTH = "the uncertainty of a published band's width is unknown"
_QUARTILES = (
    "only medians and quartile bands are published, which give no 95% interval (a quartile band "
    "contains the median with only 65.6%)"
)
_ONE_SEED = "only one seed each is published"
_PRINTED_STEPS = "PPO's steps are taken as printed"
_OPPOSITE: dict[Verdict, Verdict] = {"supported": "contradicted", "contradicted": "supported"}
_STATISTICS = {
    "a": (IQM_DIFFERENCE, "final"),
    "b": (st.ratio(st.standard_deviation), "final"),
    "c": (IQM_DIFFERENCE, "area"),
    "e": (st.difference(st.median), "final"),
    "f": (st.ratio(st.standard_deviation), "final"),
}
"""Statistic of each claim on two configurations, and the scores of which it is."""


def examine(configurations: Sequence[Configuration]) -> list[Finding]:
    """Returns findings on the claims (a) to (g), from configurations of one kind of return.

    Two of them are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about; each pair at the last control step that every seed of both has reached.
    """
    plain = [one for one in configurations if not one.robots]
    reduced = [
        (ours, full)
        for group in differing_in(plain, "representation")
        for full in group
        for ours in group
        if (full.representation, ours.representation) == (FULL, REDUCED)
    ]
    found = [one for pair in reduced for one in _on_pair("abc", pair, FULL)]
    for harder, easier in product(reduced, repeat=2):
        full, other = harder[1], easier[1]
        named = (full.task, other.task) == (HARDER, EASIER)
        if named and full.comparable("task") == other.comparable("task"):
            found.append(_on_gain(harder, easier))
    found += [one for pair in _off_policy(plain) for one in _on_pair("ef", pair, ON_POLICY)]
    for one in (one for one in plain if one.has_solved_return):
        final = seed_scores(one, int(one.last_step)).final
        found.append(_solves("g", one.name, final, **_common(one)))
    return found


def _off_policy(plain: Sequence[Configuration]) -> Iterator[Pair]:
    """Yields the pairs of an off-policy algorithm and PPO.

    If both have variants, each is only compared with the first variant of the other algorithm.
    """
    for group in differing_in(plain, "algo"):
        firsts = {one.algo: one for one in reversed(group)}
        for other in (one for one in group if one.algo in OFF_POLICY):
            for ppo in (one for one in group if one.algo == ON_POLICY):
                if other is firsts[other.algo] or ppo is firsts[ON_POLICY]:
                    yield other, ppo


def examine_heuristic(task: str, returns: FloatArray) -> Finding:
    """Returns the finding on claim (h) from returns (episodes,) of a task's hand-written policy."""
    return _solves("h", task, returns, returns=EVALUATION)


def _solves(claim: str, compared: str, values: FloatArray, **more: Any) -> Finding:
    effect, count = st.estimate(st.median, [values]), len(values)
    return Finding(claim, compared, effect, count, *decide_solved(effect, count), **more)


def _common(*compared: Configuration) -> dict[str, Any]:
    """Returns the fields that all findings on the same configurations share."""
    more = {"steps": int(min(one.last_step for one in compared)), "remark": _cut(*compared)}
    return {"returns": compared[0].kind, "source": compared[0].source, **more}


def _cut(*compared: Configuration) -> str:
    """Returns a remark if some seeds have fewer control steps than others; else an empty text."""
    common, longest = min(one.last_step for one in compared), max(one.longest for one in compared)
    if common == longest:
        return ""
    return f"at {steps(common)} of {steps(longest)} control steps, the last that every seed has"


def _on_pair(claims: str, pair: Pair, baseline: str) -> Iterator[Finding]:
    """Yields the findings on some claims, each that the first differs from the second."""
    one = Comparison(*pair)
    for claim in claims:
        sample, more = one.sample(*_STATISTICS[claim]), _common(*pair)
        effect = sample.estimate()
        if claim == "a":
            outer, effect = effect, sample.estimate(0.9)
            verdict, needed = decide_similar(effect, outer, one.seeds)
        elif claim in "bf":
            verdict, needed = decide(effect, one.seeds, 1.0, logarithmic=True)
            verdict = _without_episodes(claim, one, verdict, more)
        else:
            verdict, needed = decide(effect, one.seeds, 0)
        compared = f"{pair[0].name} against {baseline}"
        yield Finding(claim, compared, effect, one.seeds, verdict, needed, **more)


def _without_episodes(
    claim: str, one: Comparison, verdict: Verdict, more: dict[str, Any]
) -> Verdict:
    """Returns the verdict on a ratio, undecided if the variation of episodes may explain it.

    Claim (b) is that the first agents vary less, (f) that they vary more.

    Args:
        more: fields of the finding, of which `by_episodes` is set and the remark is completed.
    """
    deviations = (scores.deviation_by_episodes for scores in (one.ours, one.theirs))
    more["by_episodes"] = _ratio(*deviations)
    value, low, high, _ = one.agents_difference()
    if not {"supported": low > 0, "contradicted": high < 0}.get(verdict, True):
        interval = f"difference {value:+.0f} [{low:+.0f}, {high:+.0f}]"
        reason = f"of the agents alone: {interval if np.isfinite(value) else 'unknown'}"
        verdict = "undecided"
        more["remark"] = "; ".join(filter(None, (reason, more["remark"])))
    return _OPPOSITE.get(verdict, verdict) if claim == "b" else verdict


def _on_gain(harder: Pair, easier: Pair) -> Finding:
    comparisons = Comparison(*harder), Comparison(*easier)
    scores = [scores for one in comparisons for scores in (one.ours, one.theirs)]
    effect = st.estimate(_gain_of_gains, *([one.area] for one in scores))
    seeds = min(one.seeds for one in comparisons)
    name = ", ".join(filter(None, (harder[1].algo, harder[1].words)))
    untested = _no_gain_to_compare(scores)
    verdict, needed = ("undecided", None) if untested else decide(effect, seeds, 0)
    more = _common(*harder) | {"steps": min(one.control_steps for one in scores)}
    more["remark"] = "; ".join(filter(None, (untested, _cut(*harder), _cut(*easier))))
    compared = f"{name}: {HARDER} against {EASIER}"
    return Finding("d", compared, effect, seeds, verdict, needed, **more)


def _no_gain_to_compare(scores: Sequence[Scores]) -> str:
    """Returns why gains test nothing on claim (d); else an empty text.

    Args:
        scores: of the harder task's reduced order and full observation, then of the easier task's.
    """
    for task, pair in ((HARDER, scores[:2]), (EASIER, scores[2:])):
        random = RANDOM_RETURNS[task]
        if all(abs(np.median(one.final) - random) <= MARGIN for one in pair if len(one.final)):
            return (
                f"no verdict, on {task} both are within {MARGIN:g} of random actions ({random:g})"
            )
    gain = IQM_DIFFERENCE([scores[0].area], [scores[1].area])
    return "" if gain > 0 else f"no verdict, nothing is gained on {HARDER} ({gain:+.0f})"


def _gain_of_gains(*strata: st.Strata) -> FloatArray:
    return IQM_DIFFERENCE(*strata[:2]) - IQM_DIFFERENCE(*strata[2:])


def examine_published(published: pd.DataFrame) -> list[Finding]:
    """Returns findings on the claims (a) to (g) from the published training returns.

    Returns at the end of training are compared; for (c) and (d), the mean of the median over
    training.
    """
    ends = published.groupby(CURVE).last().reset_index()
    ends["name"] = ends["task"] + " " + ends["algo"] + " " + ends["representation"]
    curves = published.groupby(CURVE)[["steps", "median"]]
    ends["over_run"] = [
        np.trapezoid(curve["median"], curve["steps"]) / np.ptp(curve["steps"])
        for _, curve in curves
    ]
    newest = ends[ends["figure"] == "Figure 9"]
    return [*_on_figure_9(newest), *_on_figures_7_and_8(ends, newest)]


def _on_figure_9(ends: pd.DataFrame) -> Iterator[Finding]:
    curves: list[Any] = list(ends.itertuples())
    for one in curves:
        effect = st.Estimate(one.median, one.q10, one.q90)
        yield _published("g", one.name, effect, _BAND, decide_solved(effect, one.seeds)[0], one)
    for ppo in (one for one in curves if one.algo == ON_POLICY):
        for one in (one for one in curves if one.task == ppo.task and one.algo in OFF_POLICY):
            compared = f"{one.name} against {ON_POLICY}"
            effect = st.Estimate(one.median - ppo.median, one.q10 - ppo.q90, one.q90 - ppo.q10)
            verdict = decide(effect, one.seeds, 0)[0]
            yield _published("e", compared, effect, f"{_BAND}; {_PRINTED_STEPS}", verdict, one)
            remark = f"ratio of the 10-90 widths; {_NO_WIDTH}; {_PRINTED_STEPS}"
            effect = st.Estimate(_ratio(one.q90 - one.q10, ppo.q90 - ppo.q10))
            yield _published("f", compared, effect, remark, "undecided", one)


def _on_figures_7_and_8(ends: pd.DataFrame, newest: pd.DataFrame) -> Iterator[Finding]:
    compared = ends[ends["representation"] == FULL].merge(
        ends[ends["representation"] == REDUCED], on=CURVE[:3], suffixes=("_full", "")
    )
    baseline = newest["median"][newest["name"] == f"{HARDER} ddpg {FULL}"]
    curves: list[Any] = list(compared.itertuples())
    for one in curves:
        remark = _ONE_SEED if one.seeds == 1 else _QUARTILES
        if one.figure == "Figure 8" and len(baseline):
            remark += f"; Figure 8's own baseline ends at {one.median_full:.0f}, Figure 9's of the "
            remark += f"same task and algorithm at {baseline.iloc[0]:.0f}"
        effects = {
            "a": (one.median - one.median_full, remark),
            "c": (one.over_run - one.over_run_full, f"difference of medians; {remark}"),
        }
        if np.isfinite(one.q25):
            widths = _ratio(one.q75 - one.q25, one.q75_full - one.q25_full)
            effects["b"] = widths, f"ratio of the quartile bands' widths; {_NO_WIDTH}"
        name = f"{one.name} against {FULL}"
        for claim, (effect, why) in effects.items():
            yield _published(claim, name, st.Estimate(effect), why, "undecided", one)
    gains = (compared["over_run"] - compared["over_run_full"]).groupby(compared["task"]).last()
    if {EASIER, HARDER} <= {*gains.index}:
        gain = st.Estimate(float(gains[HARDER]) - float(gains[EASIER]))
        more: dict[str, Any] = {"source": "Figures 7 and 8"}
        more["remark"] = f"Figure 8's gain less Figure 7's; there, {_ONE_SEED}"
        named = f"ddpg: {HARDER} against {EASIER}"
        yield Finding("d", named, gain, 1, "undecided", None, TRAINING, **more)


def _published(
    claim: str, compared: str, effect: st.Estimate, remark: str, verdict: Verdict, curve: Any
) -> Finding:
    more = {"source": curve.figure, "remark": remark}
    return Finding(claim, compared, effect, curve.seeds, verdict, None, TRAINING, **more)


def _ratio(ours: float, theirs: float) -> float:
    return ours / theirs if theirs > 0 else np.nan
