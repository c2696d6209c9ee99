"""Decisions of the group-sequential test on the comparisons that the shipped studies plan."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jbench.names import ReturnsName
from jbench.report.data.configuration import ID, Configuration
from jbench.returns import EVALUATION, TRAINING
from jbench.studies.arms import Arm, run_key
from jbench.studies.comparisons import file_comparisons
from jbench.studies.deciding import Returns, compared_return, decide
from jbench.studies.entries import Claim
from jbench.studies.quantities import QUANTITIES, SPEED
from jbench.studies.shipped import shipped_studies
from jbench.studies.study import PlannedComparison

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


@dataclass(frozen=True)
class RecordedComparison:
    """A planned comparison with the configurations that were recorded of its arms.

    Attributes:
        study: name of its file.
        first, second: empty if the results have no runs of the arm.
    """

    study: str
    comparison: PlannedComparison
    first: ByKind
    second: ByKind

    @property
    def kind(self) -> ReturnsName | None:
        """What is compared: evaluations, or training if not both have them; None without runs."""
        for kind in (EVALUATION, TRAINING):
            if kind in self.first and kind in self.second:
                return kind
        return None

    @property
    def returns(self) -> tuple[Returns, Returns]:
        """What is compared of the runs of both arms: returns of one kind."""
        if self.kind is None:
            return {}, {}

        claim = self.comparison.claim
        first = _returns(self.first, self.comparison.first, claim, self.kind)
        second = _returns(self.second, self.comparison.second, claim, self.kind)
        return first, second


Study = Sequence[RecordedComparison]
"""The comparisons of a study, which share its error rate."""


def recorded_comparisons(
    configurations: Sequence[Configuration],
    studies: Mapping[str, Sequence[PlannedComparison]] | None = None,
    files: Iterable[str] = (),
) -> list[Study]:
    """Returns the comparisons of studies by name, once for each source of runs.

    Without studies, they are the shipped ones on the tasks of the configurations, and those of
    matrix files, which are named without .toml. Raises a RequestError if a file can't be used.
    """
    if studies is None:
        shipped = shipped_studies({config.task for config in configurations})
        own = {Path(file).stem: file_comparisons(file) for file in files}
        studies = {**shipped, **own}

    found: list[Study] = []
    for source in dict.fromkeys(config.source for config in configurations):
        by_key = _by_key([config for config in configurations if config.source == source])
        for study, comparisons in studies.items():
            matched = [
                RecordedComparison(
                    study, one, by_key.get(one.first.key, {}), by_key.get(one.second.key, {})
                )
                for one in comparisons
            ]
            found.append(matched)

    return found


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
        by_kind = {config.returns_name: config for config in configs}
        if len(by_kind) == len(configs):
            by_key[key] = by_kind

    return by_key


def decision_frame(studies: Sequence[Study]) -> pd.DataFrame:
    """Returns the decisions of the group-sequential test on the comparisons of studies.

    These are the comparisons of `jbench sweep STUDY --until-decided` that have a block of seeds.
    The interval of the difference is a repeated one, and spent a part of the error rate, which
    each study has for itself. against_words are the settings of the second side that differ from
    the defaults.
    """
    rows = [row for study in studies for row in _decided(study)]
    return pd.DataFrame(rows, columns=DECISIONS)


def _decided(study: Study) -> Iterator[dict[str, Any]]:
    """Yields a row for each comparison of a study that has a block of seeds."""
    comparisons = [one.comparison for one in study]
    returns = [one.returns for one in study]
    for one, decision in zip(study, decide(comparisons, returns), strict=True):
        if one.kind is None or not decision.seeds:
            continue

        first = one.first[one.kind]
        second = one.second[one.kind]
        claim = one.comparison.claim
        yield {
            **first.identity,
            **decision._asdict(),
            "study": one.study,
            "claim": claim,
            "baseline": second.configuration,
            "against": second.identity["representation"],
            "against_words": second.words,
            "verdict": QUANTITIES[claim].word(decision.verdict),
        }


def _returns(by_kind: ByKind, arm: Arm, claim: Claim, kind: ReturnsName) -> dict[int, float | None]:
    """Returns the returns of a kind of finished runs by seed.

    A run without any, as one that was not evaluated, has None: its training returns include
    exploration. So has a run that was not evaluated as the arm says, if means over the run are
    compared: those of different evaluations are not comparable.
    """
    returns: dict[int, float | None] = {}
    usable = {
        name: config.finished & (config.steps == arm.run.steps) for name, config in by_kind.items()
    }
    for name, config in by_kind.items():
        returns |= dict.fromkeys(config.seeds[usable[name]].tolist())

    config = by_kind[kind]
    for row in np.flatnonzero(usable[kind]):
        is_alike = config.evaluate_every[row] == arm.run.evaluate_every
        if claim == SPEED.claim and kind == EVALUATION and not is_alike:
            continue

        # Not those of `seed_scores`, which depend on the steps of the other seeds.
        points = config.returns[row, : config.lengths[row]]
        returns[int(config.seeds[row])] = compared_return(points, kind, claim)

    return returns
