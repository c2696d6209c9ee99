"""The paper's claims, each with a test that was fixed before looking at data.

A claim is tested on every pair of configurations to which it applies. The statistic, the value that
would refute it and the margin are the same for our runs, for the published curves, and for both
kinds of return.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from importlib import resources
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL, REPRESENTATION, kind_in
from jbench.report.analysis.baselines import with_baselines
from jbench.report.analysis.decisions import StudyComparison
from jbench.report.analysis.findings import Decided, Finding, decide, decide_solved
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, seed_scores
from jbench.report.data.configuration import Configuration, differing_in
from jbench.report.data.scores import Scores
from jbench.report.numbers import ratio, signed, steps, whole, with_interval
from jbench.settings.algorithms import display_name
from jbench.settings.recorded import comparable
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.studies.deciding import MARGIN, margin
from jbench.studies.study import RAW

COLUMNS = [
    "claim",
    "statement",
    "test",
    "source",
    "returns",
    "compared",
    "seeds",
    "steps",
    "effect",
    "low",
    "high",
    "by_episodes",
    "verdict",
    "seeds_needed",
    "seeds_needed_by",
    "remark",
    "text",
]

_OFF_POLICY = ("ddpg", "sac", "td3")
_ON_POLICY = "ppo"
_HARDER = "move_in_direction"  # the task of Figure 8
_EASIER = "face_direction"  # that of Figure 7
# Median return of random actions in 100 episodes (`jbench evaluate random`).
_RANDOM_RETURNS = {_EASIER: 220.0, _HARDER: 303.0}

_STATISTICS = {
    "a": (IQM_DIFFERENCE, "final"),
    "b": (st.ratio(st.standard_deviation), "final"),
    "c": (IQM_DIFFERENCE, "area"),
    "e": (st.difference(st.median), "final"),
    "f": (st.ratio(st.standard_deviation), "final"),
}
"""Of each claim on two configurations, and the scores of which it is."""

_RATIOS = ("b", "f")
"""Claims whose effect is a ratio."""

_FORMS: dict[str, Callable[[float], str]] = {"b": ratio, "f": ratio, "g": whole, "h": whole}
"""How effects read in texts; those of other claims are differences."""


def paper_claims() -> pd.DataFrame:
    """Returns the statement and the test of each claim, with its letter as index."""
    file = resources.files("jbench.paper").joinpath("claims.csv")
    return pd.read_csv(str(file), index_col="claim")


def claim_frame(
    findings: Iterable[Finding] = (), published: Iterable[dict[Any, Any]] = ()
) -> pd.DataFrame:
    """Returns a row per comparison that tests a claim of the paper, in the order of the claims.

    Published findings are rows of `published_findings`.
    """
    claims = paper_claims()
    usual = {"by_episodes": np.nan, "seeds_needed": None, "seeds_needed_by": "", "remark": ""}
    rows = [finding.row() for finding in findings] + [usual | row for row in published]
    rows = [claims.loc[row["claim"]].to_dict() | row for row in rows]
    for row in rows:
        row["text"] = _text(row)
    rows.sort(key=lambda row: str(row["claim"]))
    return pd.DataFrame(rows, columns=COLUMNS).astype({"steps": "Int64", "seeds_needed": "Int64"})


def _text(row: dict[str, Any]) -> str:
    """Returns a finding as the table shows it: the verdict, the effect and its interval."""
    form = _FORMS.get(row["claim"], signed)
    value = row["effect"]
    ends = (row["low"], row["high"])
    known_ends = ends if np.isfinite(ends).all() else ()
    known = "unknown" if np.isnan(value) else with_interval(form, value, known_ends)
    return f"{row['verdict']}: {known}"


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


def examine(
    configurations: Sequence[Configuration], planned: Sequence[Sequence[StudyComparison]] = ()
) -> Iterator[Finding]:
    """Yields findings on the claims (a) to (g), from configurations of one kind of return.

    Two of them are compared if they have the same source, use the plain robot, and differ only in
    what the claim is about. The full observation is that of the task (`full`), or as a study names
    it, in SI units (`raw`).
    """
    plain = [config for config in configurations if not config.robots]
    reduced = [
        pair
        for pair in with_baselines(plain, planned)
        if _is_reduced(pair.ours.representation)
        and kind_in(pair.theirs.representation) in (FULL, RAW)
    ]
    for pair in reduced:
        for claim in "abc":
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
                for claim in "ef":
                    yield _on_pair(claim, Pair(other, ppo), display_name(_ON_POLICY))

    for config in plain:
        if config.has_solved_return:
            final = seed_scores(config, int(config.last_step)).final
            returns, source, at, remark = _common(config)
            finding = examine_solving("g", config.name, final)
            yield replace(finding, returns=returns, source=source, steps=at, remark=remark)


def examine_solving(claim: str, compared: str, returns: FloatArray) -> Finding:
    """Returns the finding on (g) from final returns (seeds,), or on (h) from those of episodes."""
    effect = st.estimate(st.median, [returns])
    count = len(returns)
    return Finding(claim, compared, effect, count, decide_solved(effect, count))


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
    """Returns whether two pairs of the tasks of (d) have the same settings and the same design.

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
    return first.kind, first.source, int(common), "" if common == longest else reached


def _on_pair(claim: str, pair: Pair, baseline: str) -> Finding:
    """Tests a claim on the returns of a reduced representation and of its baseline."""
    is_ratio = claim in _RATIOS
    sample = pair.sample(*_STATISTICS[claim])
    contradicting = sample.estimate()
    supporting = contradicting
    low = 1.0 if is_ratio else 0.0
    high = np.inf
    if claim == "a":  # two one-sided tests at 5%
        supporting = sample.estimate(0.9)
        high = margin(pair.ours.task)
        low = -high

    decided = decide(supporting, pair.seeds, low, high, outer=contradicting, logarithmic=is_ratio)
    returns, source, at, remark = _common(*pair.sides)
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
    return _without_episodes(finding, pair) if is_ratio else finding


def _without_episodes(finding: Finding, pair: Pair) -> Finding:
    """Returns a finding on a ratio, undecided if the variation of episodes may explain it.

    Claim (b) is that the first agents vary less, (f) that they vary more.
    """
    decided = finding.decided
    remark = finding.remark
    value, low, high, _ = pair.agents_difference()
    if not {"supported": low > 0, "contradicted": high < 0}.get(decided.verdict, True):
        interval = f"difference {with_interval(signed, value, (low, high))}"
        reason = f"of the agents alone: {interval if np.isfinite(value) else 'unknown'}"
        decided = replace(decided, verdict="undecided")
        remark = "; ".join(filter(None, (reason, remark)))

    if finding.claim == "b":
        opposite = {"supported": "contradicted", "contradicted": "supported"}
        decided = replace(decided, verdict=opposite.get(decided.verdict, decided.verdict))

    ours, theirs = (side.deviation_by_episodes for side in pair.scores)
    by_episodes = ours / theirs if theirs > 0 else np.nan
    return replace(finding, decided=decided, remark=remark, by_episodes=by_episodes)


def _on_gain(harder: Pair, easier: Pair) -> Finding:
    """Tests whether reduction gains more on the harder of two tasks."""
    scores = [*harder.scores, *easier.scores]
    effect = st.estimate(
        lambda *areas: IQM_DIFFERENCE(*areas[:2]) - IQM_DIFFERENCE(*areas[2:]),
        *([side.area] for side in scores),
    )
    seeds = min(harder.seeds, easier.seeds)
    untested = _no_gain_to_compare(scores)
    words = ", ".join(filter(None, (display_name(harder.ours.algo), harder.ours.words)))
    returns, source, _, remark = _common(*harder.sides)
    *_, other = _common(*easier.sides)

    return Finding(
        claim="d",
        compared=f"{words}: {_HARDER} against {_EASIER}",
        effect=effect,
        seeds=seeds,
        decided=Decided() if untested else decide(effect, seeds, 0),
        returns=returns,
        source=source,
        steps=min(harder.control_steps, easier.control_steps),
        remark="; ".join(filter(None, (untested, remark, other))),
    )


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
    return "" if gain > 0 else f"no verdict, nothing is gained on {_HARDER} ({signed(gain)})"
