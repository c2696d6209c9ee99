"""Verdicts on differences, of representations and others, each corrected for those of its family.

A verdict rests on an interval at a level that Holm's step-down procedure gives (S. Holm, *A simple
sequentially rejective multiple test procedure*, Scand. J. Statist. 6, 1979): 5% over the number of
comparisons, then over the number of those that are left, and so on. Comparisons of final evaluation
returns that are in the list of `jbench sweep question --until-decided` have the verdict of its
group-sequential test.

An encoder scales its inputs before it reduces them. A difference from `full` is therefore due to
scaling and reduction together; `scaled` is the observation with the same scaling.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from jbench.names import FULL, ReturnsName, kind_in
from jbench.report.analysis.claims import Row
from jbench.report.analysis.scores import IQM_DIFFERENCE, Pair, seed_scores
from jbench.report.data.configuration import ID, Configuration, differing_in, with_returns
from jbench.report.data.returns import EVALUATION, KINDS, TRAINING, signed, whole
from jbench.statistics import bootstrap as st
from jbench.statistics.step_down import corrected_level
from jbench.studies.arms import Arm, run_key
from jbench.studies.deciding import MARGIN, WORDS, decide, decided_word
from jbench.studies.study import BASELINES, SCALED, PlannedComparison, shipped_studies

VERDICTS = [
    *(*ID, "against", "baseline", "claim", "verdict", "mark", "value", "low", "high"),
    *("corrected_low", "corrected_high", "corrected_by", "text", "seeds", "steps"),
]
DECISIONS = [
    *ID,
    "study",
    "claim",
    "baseline",
    "against",
    "against_words",
    "verdict",
    "seeds",
    "difference",
    "low",
    "high",
    "spent",
]
_SEQUENTIAL = "sequential test"  # origin of its verdicts
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
    keys = ["configuration", "baseline", "claim", "returns"]
    rows: list[Row] = []
    listed = {tuple(row[key] for key in keys): row for row in decisions.to_dict("records")}
    for kind in KINDS:
        asked = [
            _row(claim, pair)
            for pair in _pairs(with_returns(configurations, kind))
            for claim in WORDS
            if claim != "b" or min(len(config.seeds) for config in pair.sides) >= st.MIN_SEEDS
        ]
        for row in asked:
            if decided := listed.get(tuple(row[key] for key in keys)):
                verdict, low, high = (decided[name] for name in ("verdict", "low", "high"))
                _conclude(row, verdict, low, high, _SEQUENTIAL)
        for claim in WORDS:
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
    """Returns the decisions of the group-sequential test on the comparisons of shipped studies.

    These are the comparisons of `jbench sweep STUDY --until-decided` that have a block of seeds.
    The interval of the difference is a repeated one, and spent a part of the error rate, which
    each study has for itself. against_words are the settings of the second side that differ from
    the defaults.
    """
    rows: list[Row] = []
    studies = shipped_studies()
    sources = dict.fromkeys(config.source for config in configurations)
    for source in sources:
        by_key = _by_key([config for config in configurations if config.source == source])
        for study, comparisons in studies.items():
            rows += _decided(study, comparisons, by_key)
    return pd.DataFrame(rows, columns=DECISIONS)


ByKind = Mapping[ReturnsName, Configuration]
"""The configurations of some runs by kind of return."""


def _by_key(configurations: Iterable[Configuration]) -> dict[str, ByKind]:
    """Returns the configurations of the plain robot by the key of their arms; see `Arm.key`.

    A key is left out if several have it, such as those with different encoders of one name: which
    one a study means is unknown.
    """
    found: dict[str, list[Configuration]] = {}
    for config in configurations:
        if not config.robots:
            for steps in dict.fromkeys(config.steps):
                key = run_key(config.settings, int(steps))
                found.setdefault(key, []).append(config)
    by_key: dict[str, ByKind] = {}
    for key, configs in found.items():
        by_kind = {config.kind: config for config in configs}
        if len(by_kind) == len(configs):
            by_key[key] = by_kind
    return by_key


def _decided(
    study: str, comparisons: Sequence[PlannedComparison], by_key: Mapping[str, ByKind]
) -> Iterator[Row]:
    """Yields a row for each comparison of a study that has a block of seeds."""
    sides = [(by_key.get(one.first.key, {}), by_key.get(one.second.key, {})) for one in comparisons]
    returns = [
        (_returns(ours, one.first, one.claim), _returns(theirs, one.second, one.claim))
        for one, (ours, theirs) in zip(comparisons, sides, strict=True)
    ]
    decisions = decide(comparisons, returns)
    for one, (ours, theirs), decision in zip(comparisons, sides, decisions, strict=True):
        if decision.seeds:
            kind = EVALUATION if EVALUATION in ours and EVALUATION in theirs else TRAINING
            first, second = ours[kind], theirs[kind]
            yield {
                **first.identity,
                **decision._asdict(),
                "study": study,
                "claim": one.claim,
                "baseline": second.configuration,
                "against": second.identity["representation"],
                "against_words": second.words,
                "verdict": decided_word(decision.verdict, one.claim),
            }


def _returns(by_kind: ByKind, arm: Arm, claim: str) -> dict[int, float]:
    """Returns the returns of finished runs by seed: of evaluations, or without any of training."""
    returns: dict[int, float] = {}
    for kind in (TRAINING, EVALUATION):
        if kind in by_kind:
            config = by_kind[kind]
            scores = seed_scores(config)
            usable = (config.finished & (config.steps == arm.run.steps))[scores.known]
            values = scores.final if claim == "a" else scores.area
            seeds = config.seeds[scores.known]
            returns |= dict(zip(seeds[usable].tolist(), values[usable].tolist(), strict=True))
    return returns


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
        if claim == "a" and verdict in WORDS["a"] and margin:
            beyond = "yes" if min(abs(low), abs(high)) > margin else "undecided"
            text += f"; by more than {margin:g}: {beyond}"
    if claim != "a" or verdict not in WORDS["a"]:
        text = f"{verdict}: {text}"
    row |= {"verdict": verdict, "mark": _MARKS[verdict], "text": text}
    row |= {"corrected_low": low, "corrected_high": high, "corrected_by": by}


def _word(low: float, high: float, claim: str, margin: float) -> str:
    if claim == "a" and low > -margin and high < margin:
        return "similar"
    above, below = WORDS[claim]
    return above if low > 0 else below if high < 0 else "undecided"
