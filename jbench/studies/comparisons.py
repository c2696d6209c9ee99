"""What a matrix file compares: the comparisons that it lists, or those with the baselines."""

from collections.abc import Collection, Mapping

from jbench.errors import RequestError
from jbench.names import MAX_SEEDS
from jbench.studies.entries import Entry, read_entries
from jbench.studies.matrix import Parts, read_matrix
from jbench.studies.study import (
    PlannedComparison,
    chosen,
    default_comparisons,
    listed_comparisons,
)


def comparisons(
    parts: Parts, entries: Mapping[str, Entry], typed: Collection[str], max_seeds: int = MAX_SEEDS
) -> list[PlannedComparison]:
    """Returns the planned comparisons, or those of each reduced representation with each baseline.

    Args:
        entries: of the file; see `entries.read_entries`.
        typed: representations such as `dae12`, or pairs such as `dae12/full`; none for all.
        max_seeds: for entries that have none.

    Raises a RequestError if there are no comparisons, a name matches none of them, or the parts
    have not exactly one pair of arms for an entry.
    """
    if entries:
        return chosen(listed_comparisons(parts, entries, max_seeds), typed, listed=True)

    every = default_comparisons(parts, max_seeds)
    if not every:
        raise RequestError(
            "No two configurations of this matrix differ only in a representation and full, "
            "scaled or raw, so there is nothing to decide; list what to compare as [[comparison]] "
            "(docs/deciding.md)."
        )

    return chosen(every, typed, listed=False)


def file_comparisons(name: str) -> list[PlannedComparison]:
    """Returns the comparisons of a matrix file, as `jbench sweep FILE --until-decided` makes them.

    Raises a RequestError if there is no such file, it is invalid, or it compares nothing.
    """
    return comparisons(read_matrix(name), read_entries(name), ())


def check_comparisons(name: str) -> None:
    """Raises a RequestError if a matrix file lists a comparison that is invalid, or of no runs."""
    entries = read_entries(name)
    if entries:
        listed_comparisons(read_matrix(name), entries)
