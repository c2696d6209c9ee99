"""Verdicts on representations, each corrected for the other ones.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling. Comparisons of
final evaluation returns that are in the list of `jbench sweep question --until-decided` have the
verdict of its group-sequential test.
"""

import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL, kind_in
from jbench.report.analysis.claims import MARGIN
from jbench.report.analysis.judge import SEQUENTIAL, WORDS, conclude, judge
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, PairedScores, seed_scores
from jbench.report.data.configuration import ID, Configuration, differing_in, with_returns
from jbench.report.data.returns import EVALUATION, KINDS, display_name, shown_representation
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.statistics.sequential import BLOCK
from jbench.statistics.step_down import decide

SCALED = "scaled"
BASELINES = (FULL, SCALED)  # of reduced representations: without and with the encoders' scaling
VERDICTS = [
    *(*ID, "against", "baseline", "claim", "verdict", "mark", "value", "low", "high"),
    *("corrected_low", "corrected_high", "corrected_by", "text", "seeds", "steps"),
]
DECISIONS = [
    *("source", "task", "algo", "representation", "against", "verdict", "seeds", "difference"),
    *("low", "high", "spent"),
]
_DECIDED = {"larger": "higher", "smaller": "lower", "equal": "similar"}
_MAX_SEEDS = 30  # of the group-sequential test


def verdict_frame(configurations: Sequence[Configuration], decisions: pd.DataFrame) -> pd.DataFrame:
    """Returns the verdicts on each reduced representation, and on `scaled`, the effect of scaling.

    The claims are (a) final return, (b) variability of three or more seeds and (c) speed. baseline
    is a configuration, and value has a 95% interval; for the others see `judge.conclude`.
    """
    keys, rows = [*DECISIONS[:5], "claim", "returns", "words"], []
    planned = decisions.assign(claim="a", returns=EVALUATION, words="").to_dict("records")
    listed = {tuple(row[key] for key in keys): row for row in planned}
    for kind in KINDS:
        asked = [
            _row(claim, *pair)
            for pair in _pairs(with_returns(configurations, kind))
            for claim in WORDS
            if claim != "b" or min(len(config.seeds) for config in pair) >= st.MIN_SEEDS
        ]
        for row in asked:
            if decided := listed.get(tuple(row[key] for key in keys)):
                verdict, low, high = (decided[name] for name in ("verdict", "low", "high"))
                conclude(row, verdict, low, high, SEQUENTIAL, "a", MARGIN)
        for claim in WORDS:
            judge([row for row in asked if row["claim"] == claim and "verdict" not in row], claim)
        rows += asked
    return pd.DataFrame(rows, columns=VERDICTS)


def _pairs(configurations: Sequence[Configuration]) -> Iterator[Pair]:
    for group in differing_in(configurations, "representation"):
        baselines = {kind_in(config.representation): config for config in reversed(group)}
        for ours in group:
            others = {FULL: (), SCALED: (FULL,)}.get(kind_in(ours.representation), BASELINES)
            yield from ((ours, baselines[name]) for name in others if name in baselines)


def _row(claim: str, ours: Configuration, theirs: Configuration) -> dict[str, Any]:
    """Returns a row of `verdict_frame` without its verdict, as `judge` needs it."""
    pair = PairedScores(ours, theirs)
    row: dict[str, Any] = {**ours.identity, "claim": claim}
    row |= {"baseline": theirs.configuration, "seeds": pair.seeds, "steps": pair.control_steps}
    row |= {"against": shown_representation(theirs.representation), "decidable": pair.decidable}
    if claim == "b":
        row |= pair.agents_difference()._asdict()
        row["interval"] = lambda confidence: pair.agents_difference(confidence)[1:3]
    else:
        sample = pair.sample(IQM_DIFFERENCE, "final" if claim == "a" else "area")
        row |= sample.estimate()._asdict() | {"interval": sample.interval}
    return row


def decision_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the decisions of the group-sequential test on the planned comparisons.

    These are the comparisons of `jbench sweep question --until-decided` that have a block of seeds,
    by the means of their final evaluation returns. The interval of the difference is a repeated
    one, and spent a part of the error rate.
    """
    rows, planned = [], _planned()
    shares, analyses = [plan["share"] for plan in planned], [_MAX_SEEDS // BLOCK] * len(planned)
    known: dict[str, dict[tuple[str, ...], Configuration]] = {}
    for config in with_returns(configurations, EVALUATION):
        if not (config.words or config.robots):
            for name in (config.representation, shown_representation(config.representation)):
                known.setdefault(config.source, {})[config.task, config.algo, name] = config
    for source, named in known.items():
        pairs = []
        for plan in planned:
            sides = (named.get((plan["task"], plan["algo"], plan[s])) for s in ("first", "second"))
            ours, theirs = (_first_seeds(side, plan["steps"]) for side in sides)
            pairs.append((ours, theirs))
        if not any(min(map(len, pair)) >= BLOCK for pair in pairs):
            continue
        for plan, decision in zip(planned, decide(pairs, shares, analyses, MARGIN), strict=True):
            first, second = (shown_representation(plan[side]) for side in ("first", "second"))
            names = {"source": source, "algo": display_name(plan["algo"]), "task": plan["task"]}
            names |= {"representation": first, "against": second}
            names["verdict"] = _DECIDED.get(decision.verdict, decision.verdict)
            rows += [decision._asdict() | names] if decision.seeds else []
    return pd.DataFrame(rows, columns=DECISIONS)


@cache
def _planned() -> list[dict[str, Any]]:
    """Returns the comparisons that the matrix `question` lists, with their control steps."""
    text = resources.files("jbench.paper").joinpath("matrices", "question.toml").read_text("utf-8")
    matrix = tomllib.loads(text)

    def has(part: dict[str, Any], plan: dict[str, Any]) -> bool:
        fits = plan["task"] in part.get("tasks", matrix["tasks"]) and plan["algo"] in part["algos"]
        named = shown_representation(plan["first"]) in part.get("representations", (FULL,))
        return fits and named and not part.get("hyperparameters")

    return [
        {**plan, "steps": next(part["steps"] for part in matrix["part"] if has(part, plan))}
        for plan in matrix["comparison"]
    ]


def _first_seeds(configuration: Configuration | None, steps: int) -> FloatArray:
    """Returns the final returns of seeds 0, 1, … that are finished, up to the first gap."""
    if configuration is None:
        return np.empty(0)
    scores = seed_scores(configuration)
    usable = configuration.finished & scores.known & (configuration.steps == steps)
    usable &= configuration.seeds == np.arange(len(configuration.seeds))
    return scores.final[: int(np.logical_and.accumulate(usable).sum())]
