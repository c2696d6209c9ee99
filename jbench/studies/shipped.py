"""The studies that are shipped: matrices of jbench that list comparisons."""

from collections.abc import Collection
from functools import cache

from jbench.names import SWEEPS
from jbench.studies.entries import Entry, read_entries
from jbench.studies.matrix import read_matrix
from jbench.studies.study import PlannedComparison, listed_comparisons


def shipped_studies(tasks: Collection[str] | None = None) -> dict[str, list[PlannedComparison]]:
    """Returns the comparisons of the shipped files that list some, by the names of the files.

    With tasks, they are those of the files that compare agents on one of them: the robots of other
    tasks would have to be made, which takes a second.
    """
    listed = {name: {entry.task for entry in _shipped_entries(name).values()} for name in SWEEPS}
    return {
        name: _shipped_study(name)
        for name, of_study in listed.items()
        if of_study and (tasks is None or not of_study.isdisjoint(tasks))
    }


@cache
def _shipped_entries(name: str) -> dict[str, Entry]:
    """Returns the comparisons that a shipped file lists, if any."""
    return read_entries(name)


@cache
def _shipped_study(name: str) -> list[PlannedComparison]:
    """Returns the comparisons of a shipped file with their arms."""
    return listed_comparisons(read_matrix(name), _shipped_entries(name))
