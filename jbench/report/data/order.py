"""The order of a report: tasks, algorithms and representations as in the paper."""

import re
from collections.abc import Iterable
from typing import Any

from jbench.names import TASKS
from jbench.report.data.configuration import Configuration
from jbench.representation_names import FULL
from jbench.settings.algorithms import ALGORITHMS


def in_order(names: Iterable[str], known: tuple[str, ...] = TASKS) -> list[str]:
    """Returns distinct names: the known ones in their order, then the others alphabetically."""
    return sorted(set(names), key=lambda name: _rank(name, known))


def _rank(name: str, known: tuple[str, ...]) -> tuple[int, str]:
    """Returns the sort key of a name: known ones come first."""
    return (known.index(name), "") if name in known else (len(known), name)


def paper_order(configuration: Configuration) -> tuple[Any, ...]:
    """Returns the sort key: task, algorithm and representation as in the paper."""
    # The sort is stable: variants stay in the order of their words.
    ranks = _rank(configuration.task, TASKS), _rank(configuration.algo, ALGORITHMS)
    representation = configuration.representation
    # `planar12` is before `planar-mirror12`, and `pca4` before `pca12`: every other word is a
    # number, of which the shorter one is smaller.
    words = re.split(r"(\d+)", representation)
    natural = [(len(word), word) if place % 2 else word for place, word in enumerate(words)]
    return *ranks, representation != FULL, natural, representation, configuration.source
