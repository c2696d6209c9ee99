"""Pairs of a representation and one that reduces nothing, whose runs are otherwise equal."""

from collections.abc import Iterator, Sequence

from jbench.report.analysis.decisions import Study
from jbench.report.analysis.pair import Pair
from jbench.report.data.configuration import Configuration, differing_in
from jbench.representation_names import FULL, features_in, kind_in
from jbench.studies.study import BASELINES, RAW, SCALED


def baseline_pairs(
    configurations: Sequence[Configuration], studies: Sequence[Study] = ()
) -> Iterator[Pair]:
    """Yields the pairs of each representation with each of its baselines.

    A baseline has the same features of the observation. `scaled` is compared with `full`, all
    others with both. `raw` is a baseline where there is no `full`, or where a study compares with
    it.
    """
    named = {
        (first.configuration, one.second[kind].configuration)
        for study in studies
        for one in study
        for kind, first in one.first.items()
        if kind in one.second
    }
    for group in differing_in(configurations, "representation"):
        for ours in group:
            baselines = _of_features(group, features_in(ours.representation))
            for name in _names(ours, baselines):
                theirs = baselines[name]
                is_named = (ours.configuration, theirs.configuration) in named
                if name != RAW or FULL not in baselines or is_named:
                    yield Pair(ours, theirs)


def _of_features(group: Sequence[Configuration], features: str) -> dict[str, Configuration]:
    """Returns the configurations of some features by kind of representation, the first of each."""
    return {
        kind_in(config.representation): config
        for config in reversed(group)
        if features_in(config.representation) == features
    }


def _names(ours: Configuration, baselines: dict[str, Configuration]) -> list[str]:
    """Returns the names of the representations that one is compared with, if they were trained."""
    kind = kind_in(ours.representation)
    others: tuple[str, ...] = (*BASELINES, RAW)
    if kind == FULL:
        others = ()
    elif kind == SCALED:
        others = (FULL,)
    elif kind == RAW:
        others = BASELINES

    return [name for name in others if name in baselines]
