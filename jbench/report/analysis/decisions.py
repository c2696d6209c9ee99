"""Decisions of the group-sequential test on the comparisons that the shipped studies plan."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from jbench.names import ReturnsName
from jbench.report.analysis.scores import seed_scores
from jbench.report.data.configuration import ID, Configuration
from jbench.report.data.returns import EVALUATION, TRAINING
from jbench.studies.arms import Arm, run_key
from jbench.studies.deciding import decide, decided_word
from jbench.studies.study import PlannedComparison, shipped_studies

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

ByKind = Mapping[ReturnsName, Configuration]
"""The configurations of some runs by kind of return."""


def decision_frame(configurations: Sequence[Configuration]) -> pd.DataFrame:
    """Returns the decisions of the group-sequential test on the comparisons of shipped studies.

    These are the comparisons of `jbench sweep STUDY --until-decided` that have a block of seeds.
    The interval of the difference is a repeated one, and spent a part of the error rate, which
    each study has for itself. against_words are the settings of the second side that differ from
    the defaults.
    """
    rows: list[dict[str, Any]] = []
    studies = shipped_studies()
    sources = dict.fromkeys(config.source for config in configurations)
    for source in sources:
        by_key = _by_key([config for config in configurations if config.source == source])
        for study, comparisons in studies.items():
            rows += _decided(study, comparisons, by_key)
    return pd.DataFrame(rows, columns=DECISIONS)


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
) -> Iterator[dict[str, Any]]:
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
