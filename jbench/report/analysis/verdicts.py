"""Verdicts on representations, each corrected for the other ones.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.

Verdicts rest on intervals at a level that Holm's step-down procedure gives (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): 5% over the number of
comparisons, then over the number of those that are left, and so on. Comparisons of final evaluation
returns that are in the list of `jbench sweep question --until-decided` have the verdict of its
group-sequential test.
"""

import tomllib
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import FULL, kind_in
from jbench.report.analysis.claims import MARGIN
from jbench.report.analysis.scores import IQM_DIFFERENCE, Comparison, Ends, Pair, ends, seed_scores
from jbench.report.data.configuration import (
    ID,
    Configuration,
    differing_in,
    display_name,
    shown_representation,
    with_returns,
)
from jbench.report.data.returns import EVALUATION, KINDS, signed, whole
from jbench.statistics import FloatArray
from jbench.statistics import bootstrap as st
from jbench.statistics.sequential import BLOCK, ERROR_RATE
from jbench.statistics.step_down import decide

SCALED = "scaled"
BASELINES = (FULL, SCALED)
"""Baselines of reduced representations, without and with the encoders' scaling."""

MARKS = {
    **dict.fromkeys(("higher", "less variable", "faster"), "✓"),
    **dict.fromkeys(("lower", "more variable", "slower"), "✗"),
    **{"similar": "=", "undecided": "?"},
}
"""A mark for each verdict; a check mark speaks for the representation."""

SEQUENTIAL = "sequential test"
"""Origin of the verdicts of `--until-decided`."""

VERDICTS = [
    *(*ID, "returns", "against", "baseline", "claim", "verdict", "mark", "value", "low", "high"),
    *("corrected_low", "corrected_high", "corrected_by", "text", "seeds", "steps"),
]
DECISIONS = [
    *("source", "task", "algo", "representation", "against", "verdict", "seeds", "difference"),
    *("low", "high", "spent"),
]

_WORDS = {  # of a larger and of a smaller number
    "a": ("higher", "lower"),
    "b": ("more variable", "less variable"),
    "c": ("faster", "slower"),
}
_NUMBERS = {"a": "", "b": "standard deviation between agents ", "c": "mean return over the run "}
_DECIDED = {"larger": "higher", "smaller": "lower", "equal": "similar"}
_TOO_FEW = f"fewer than {st.DECIDING_SEEDS} seeds"
_MAX_SEEDS = 30  # of the group-sequential test


def verdict_frame(configurations: Sequence[Configuration], decisions: pd.DataFrame) -> pd.DataFrame:
    """Returns the verdicts on each reduced representation against each baseline.

    Columns: `ID`, returns, against, baseline (its configuration), claim (a: final return, b:
    variability of three or more, c: speed), verdict, mark, value with its 95% interval (low,
    high), corrected_low and corrected_high (the interval that decides), corrected_by, text, seeds,
    steps. Beside reduced representations, `scaled` is compared with `full`: the effect of scaling.
    """
    keys = ["source", "task", "algo", "representation", "against"]
    listed = {tuple(row[key] for key in keys): row for row in decisions.to_dict("records")}
    rows: list[dict[str, Any]] = []
    for kind in KINDS:
        asked = [
            _Question(ours, theirs, claim)
            for ours, theirs in _pairs(with_returns(configurations, kind))
            for claim in _WORDS
            if claim != "b" or min(len(ours.seeds), len(theirs.seeds)) >= st.MIN_SEEDS
        ]
        for claim in _WORDS:
            free = []
            for one in (one for one in asked if one.claim == claim):
                decision = listed.get(tuple(one.row[key] for key in keys))
                if decision and claim == "a" and kind == EVALUATION and not one.row["words"]:
                    one.judge(decision["low"], decision["high"], SEQUENTIAL, decision["verdict"])
                else:
                    free.append(one)
            family = [one.ends for one in free if one.decidable]
            level = corrected_level(family)
            by = f"Holm, {len(family)} comparisons" if len(family) > 1 else ""
            for one in free:
                one.judge(*one.ends(1 - level), by if one.decidable else _TOO_FEW)
        rows += [one.row for one in asked]
    return pd.DataFrame(rows, columns=VERDICTS)


class _Question:
    """A claim on two configurations, and its row of `verdict_frame`."""

    def __init__(self, ours: Configuration, theirs: Configuration, claim: str) -> None:
        one = Comparison(ours, theirs)
        self.claim, self.decidable = claim, one.decidable
        if claim == "b":
            value, low, high, _ = one.agents_difference()
            self.ends: Ends = lambda confidence: one.agents_difference(confidence)[1:3]
        else:
            sample = one.sample(IQM_DIFFERENCE, "final" if claim == "a" else "area")
            value, low, high, _ = sample.estimate()
            self.ends = ends(sample)
        self.row: dict[str, Any] = {
            **{**ours.identity, "returns": ours.kind, "claim": claim},
            "against": shown_representation(theirs.representation),
            "baseline": theirs.configuration,
            **{"value": value, "low": low, "high": high},
            **{"seeds": one.seeds, "steps": one.control_steps},
        }

    def judge(self, low: float, high: float, by: str, verdict: str | None = None) -> None:
        """Adds the verdict, by default that of a corrected interval."""
        verdict = verdict or (judged(low, high, self.claim) if self.decidable else "undecided")
        text = f"{_NUMBERS[self.claim]}{difference_text(low, high)}"
        if np.isnan(self.row["value"]):
            text = "unknown"
        elif not self.decidable or not np.isfinite([low, high]).any():
            reason = "the sequential test needs more" if by == SEQUENTIAL else "too few"
            text = f"{signed(self.row['value'])}, {reason} seeds"
        elif self.claim == "a" and verdict in ("higher", "lower"):
            beyond = "yes" if min(abs(low), abs(high)) > MARGIN else "undecided"
            text += f"; by more than {MARGIN:g}: {beyond}"
        if self.claim != "a" or verdict in ("similar", "undecided"):
            text = f"{verdict}: {text}"
        self.row |= {"verdict": verdict, "mark": MARKS[verdict], "text": text}
        self.row |= {"corrected_low": low, "corrected_high": high, "corrected_by": by}


def _pairs(configurations: Sequence[Configuration]) -> Iterator[Pair]:
    for group in differing_in(configurations, "representation"):
        baselines = {kind_in(one.representation): one for one in reversed(group)}
        for ours in group:
            others = {FULL: (), SCALED: (FULL,)}.get(kind_in(ours.representation), BASELINES)
            yield from ((ours, baselines[name]) for name in others if name in baselines)


def judged(low: float, high: float, claim: str = "a", margin: float = MARGIN) -> str:
    """Returns the verdict that an interval of a difference gives, in a word."""
    if claim == "a" and low > -margin and high < margin:
        return "similar"
    above, below = _WORDS[claim]
    return above if low > 0 else below if high < 0 else "undecided"


def corrected_level(
    intervals: Sequence[Ends], decides: Callable[[float, float], bool] | None = None
) -> float:
    """Returns the error rate of an interval in the last step of Holm's procedure.

    Args:
        decides: whether an interval decides; by default, if it has a verdict.
    """
    decides = decides or (lambda low, high: judged(low, high) != "undecided")
    level, left = 1.0, len(intervals)
    while left and (level == 1 or ERROR_RATE / left > level):
        level = ERROR_RATE / left
        left = sum(not decides(*ends(1 - level)) for ends in intervals)
    return min(level, ERROR_RATE)


def difference_text(low: float, high: float) -> str:
    """Formats an interval of a difference: `higher by 38 to 114`, `-20 to +35`."""
    if np.isnan(low):
        return "an unknown difference"
    if not np.isfinite([low, high]).any():
        return "too few seeds"
    if low > 0:
        return f"higher by {whole(low)} to {whole(high)}"
    if high < 0:
        return f"lower by {whole(-high)} to {whole(-low)}"
    return f"{signed(low)} to {signed(high)}"


def decision_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the decisions of the group-sequential test on the planned comparisons.

    These are the comparisons of `jbench sweep question --until-decided` that have a block of seeds,
    by their final evaluation returns. Columns: source, task, algo, representation, against,
    verdict, seeds, difference of the means with its repeated interval (low, high), spent (part of
    the error rate).
    """
    rows = []
    planned = _planned()
    shares, analyses = [one["share"] for one in planned], [_MAX_SEEDS // BLOCK] * len(planned)
    usual = [
        one for one in with_returns(configurations, EVALUATION) if not (one.words or one.robots)
    ]
    for source in dict.fromkeys(one.source for one in usual):
        known = {
            (one.task, one.algo, name): one
            for one in usual
            if one.source == source
            for name in (one.representation, shown_representation(one.representation))
        }
        pairs = []
        for one in planned:
            sides = (known.get((one["task"], one["algo"], one[s])) for s in ("first", "second"))
            ours, theirs = (_first_seeds(side, one["steps"]) for side in sides)
            pairs.append((ours, theirs))
        if not any(min(map(len, pair)) >= BLOCK for pair in pairs):
            continue
        decisions = decide(pairs, shares, analyses, MARGIN)
        for one, decision in zip(planned, decisions, strict=True):
            if decision.seeds:
                first, second = (shown_representation(one[side]) for side in ("first", "second"))
                names = {"source": source, "algo": display_name(one["algo"]), "task": one["task"]}
                names |= {"representation": first, "against": second}
                verdict = _DECIDED.get(decision.verdict, decision.verdict)
                rows.append(decision._asdict() | names | {"verdict": verdict})
    return pd.DataFrame(rows, columns=DECISIONS)


@cache
def _planned() -> list[dict[str, Any]]:
    """Returns the comparisons that the matrix `question` lists, with their control steps."""
    text = resources.files("jbench.paper").joinpath("matrices", "question.toml").read_text("utf-8")
    matrix = tomllib.loads(text)

    def has(part: dict[str, Any], one: dict[str, Any]) -> bool:
        return (
            one["task"] in part.get("tasks", matrix["tasks"])
            and one["algo"] in part["algos"]
            and not part.get("hyperparameters")
            and shown_representation(one["first"]) in part.get("representations", (FULL,))
        )

    return [
        {**one, "steps": next(part["steps"] for part in matrix["part"] if has(part, one))}
        for one in matrix["comparison"]
    ]


def _first_seeds(configuration: Configuration | None, steps: int) -> FloatArray:
    """Returns the final returns of seeds 0, 1, … that are finished, up to the first gap."""
    if configuration is None:
        return np.empty(0)
    scores = seed_scores(configuration)
    usable = (
        configuration.finished
        & scores.known
        & (configuration.steps == steps)
        & (configuration.seeds == np.arange(len(configuration.seeds)))
    )
    count = int(np.logical_and.accumulate(usable).sum())
    return scores.final[:count]
