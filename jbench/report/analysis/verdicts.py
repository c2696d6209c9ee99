"""Verdicts on differences, of representations and others, each corrected for those of its family.

A verdict rests on an interval at a level that Holm's step-down procedure gives (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): 5% over the number of
comparisons, then over the number of those that are left, and so on. Comparisons of final evaluation
returns that are in the list of `jbench sweep question --until-decided` have the verdict of its
group-sequential test.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.
"""

import tomllib
from collections.abc import Iterator, Sequence
from importlib import resources
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL, MAX_SEEDS, kind_in
from jbench.report.analysis.claims import MARGIN, Row
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, seed_scores
from jbench.report.data.configuration import ID, Configuration, differing_in, with_returns
from jbench.report.data.returns import EVALUATION, KINDS, shown_representation, signed, whole
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.statistics.sequential import BLOCK
from jbench.statistics.step_down import corrected_level, decide

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
_SEQUENTIAL = "sequential test"  # origin of its verdicts
_WORDS = {  # of a larger and of a smaller number
    "a": ("higher", "lower"),
    "b": ("more variable", "less variable"),
    "c": ("faster", "slower"),
}
_NUMBERS = {"a": "", "b": "standard deviation between agents ", "c": "mean return over the run "}
_MARKS = {
    **dict.fromkeys(("higher", "less variable", "faster"), "✓"),
    **dict.fromkeys(("lower", "more variable", "slower"), "✗"),
    **{"similar": "=", "undecided": "?"},
}  # a check mark speaks for the representation
_TOO_FEW = f"fewer than {st.DECIDING_SEEDS} seeds"


def verdict_frame(configurations: Sequence[Configuration], decisions: pd.DataFrame) -> pd.DataFrame:
    """Returns the verdicts on each reduced representation, and on `scaled`, the effect of scaling.

    The claims are (a) final return, (b) variability of three or more seeds and (c) speed. baseline
    is a configuration, and value has a 95% interval; for the others see `_conclude`.
    """
    keys, rows = [*DECISIONS[:5], "claim", "returns", "words"], []
    planned = decisions.assign(claim="a", returns=EVALUATION, words="").to_dict("records")
    listed = {tuple(row[key] for key in keys): row for row in planned}
    for kind in KINDS:
        asked = [
            _row(claim, pair)
            for pair in _pairs(with_returns(configurations, kind))
            for claim in _WORDS
            if claim != "b" or min(len(config.seeds) for config in pair.sides) >= st.MIN_SEEDS
        ]
        for row in asked:
            if decided := listed.get(tuple(row[key] for key in keys)):
                verdict, low, high = (decided[name] for name in ("verdict", "low", "high"))
                _conclude(row, verdict, low, high, _SEQUENTIAL)
        for claim in _WORDS:
            judge([row for row in asked if row["claim"] == claim and "verdict" not in row])
        rows += asked
    return pd.DataFrame(rows, columns=VERDICTS)


def _pairs(configurations: Sequence[Configuration]) -> Iterator[Pair]:
    for group in differing_in(configurations, "representation"):
        baselines = {kind_in(config.representation): config for config in reversed(group)}
        for ours in group:
            others = {FULL: (), SCALED: (FULL,)}.get(kind_in(ours.representation), BASELINES)
            yield from (Pair(ours, baselines[name]) for name in others if name in baselines)


def _row(claim: str, pair: Pair) -> Row:
    """Returns a row of `verdict_frame` without its verdict, as `judge` needs it."""
    row: Row = {**pair.ours.identity, "claim": claim, "baseline": pair.theirs.configuration}
    row |= {"seeds": pair.seeds, "steps": pair.control_steps, "decidable": pair.decidable}
    row["against"] = pair.theirs.identity["representation"]
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
    shares, analyses = [plan["share"] for plan in planned], [MAX_SEEDS // BLOCK] * len(planned)
    known: dict[str, dict[tuple[str, ...], Configuration]] = {}
    for config in with_returns(configurations, EVALUATION):
        if not (config.words or config.robots):
            for name in (config.representation, shown_representation(config.representation)):
                known.setdefault(config.source, {})[config.task, config.algo, name] = config
    for named in known.values():
        pairs, finals = [], []
        for plan in planned:
            sides = (named.get((plan["task"], plan["algo"], plan[s])) for s in ("first", "second"))
            ours, theirs = sides
            pairs.append((ours, theirs))
            finals.append((_first_seeds(ours, plan["steps"]), _first_seeds(theirs, plan["steps"])))
        decisions = decide(finals, shares, analyses, MARGIN)
        for (ours, theirs), decision in zip(pairs, decisions, strict=True):
            if ours and theirs and decision.seeds:
                names = {name: ours.identity[name] for name in DECISIONS[:4]}
                names["against"] = theirs.identity["representation"]
                names["verdict"] = _DECIDED.get(decision.verdict, decision.verdict)
                rows.append(decision._asdict() | names)
    return pd.DataFrame(rows, columns=DECISIONS)


def _planned() -> list[dict[str, Any]]:
    """Returns the comparisons that the matrix `question` lists, with their control steps."""
    text = resources.files("jbench.paper").joinpath("matrices", "question.toml").read_text("utf-8")
    matrix = tomllib.loads(text)
    steps: dict[tuple[Any, ...], int] = {}
    for part in reversed(matrix["part"]):  # the first of several counts
        tasks, observed = part.get("tasks", matrix["tasks"]), part.get("representations", (FULL,))
        if not part.get("hyperparameters"):
            steps |= dict.fromkeys(product(tasks, part["algos"], observed), part["steps"])
    return [
        {**plan, "steps": steps[plan["task"], plan["algo"], shown_representation(plan["first"])]}
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


def judge(family: Sequence[Row], margin: float = MARGIN) -> None:
    """Adds to rows with the same claim the verdict on each, corrected for the others.

    A row has the claim, the value of a difference, its interval (by confidence), and whether there
    are enough seeds (decidable); differences within a margin are similar.
    """
    intervals = [row["interval"] for row in family if row["decidable"]]
    level = corrected_level(
        intervals, lambda low, high: _word(low, high, "a", margin) != "undecided"
    )
    by = f"Holm, {len(intervals)} comparisons" if len(intervals) > 1 else ""
    for row in family:
        low, high = row["interval"](1 - level)
        if row["decidable"]:
            _conclude(row, _word(low, high, row["claim"], margin), low, high, by, margin)
        else:
            _conclude(row, "undecided", low, high, _TOO_FEW)


def _conclude(
    row: Row, verdict: str, low: float, high: float, by: str, margin: float = MARGIN
) -> None:
    """Adds a verdict, its mark and text to a row, and the corrected interval on which it rests."""
    claim = row["claim"]
    if np.isnan(row["value"]):
        text = "unknown"
    elif by == _TOO_FEW or not np.isfinite([low, high]).any():
        reason = "the sequential test needs more" if by == _SEQUENTIAL else "too few"
        text = f"{signed(row['value'])}, {reason} seeds"
    else:
        if low > 0:
            text = f"higher by {whole(low)} to {whole(high)}"
        elif high < 0:
            text = f"lower by {whole(-high)} to {whole(-low)}"
        else:
            text = f"{signed(low)} to {signed(high)}"
        text = _NUMBERS[claim] + text
        if claim == "a" and verdict in _WORDS["a"] and margin:
            beyond = "yes" if min(abs(low), abs(high)) > margin else "undecided"
            text += f"; by more than {margin:g}: {beyond}"
    if claim != "a" or verdict not in _WORDS["a"]:
        text = f"{verdict}: {text}"
    row |= {"verdict": verdict, "mark": _MARKS[verdict], "text": text}
    row |= {"corrected_low": low, "corrected_high": high, "corrected_by": by}


def _word(low: float, high: float, claim: str, margin: float) -> str:
    if claim == "a" and low > -margin and high < margin:
        return "similar"
    above, below = _WORDS[claim]
    return above if low > 0 else below if high < 0 else "undecided"
