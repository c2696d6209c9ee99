"""Names of the sources of runs and curves, and what is known of the returns of each.

The shipped runs are from the source `names.REFERENCE`. Other sources are results directories.
"""

from collections.abc import Iterable

from jbench.task_specs import return_range, solved_return

OWN = "own"
"""Runs in the reported results."""

IMPORTED = "imported"
"""Learning curves that were imported into the results."""

FILE = "file"
"""Curves of a file, which may be of any environment."""

PUBLISHED = "published"
"""The paper's curves."""


def directory_source(name: str) -> str:
    """Returns the source of the runs of one of several results directories: its name.

    A directory that is called as another source is, such as imported, has ./ before its name.
    """
    return f"./{name}" if name in (OWN, IMPORTED, FILE, PUBLISHED) else name


def begins_with_source(name: str, source: str) -> bool:
    """Returns whether a name or label of a configuration begins with its source.

    Names of the reported results and of a file do not; nor do those of two sides of a comparison
    that differ without their sides.
    """
    return source not in (OWN, FILE) and name.startswith(f"{source}: ")


def has_solved_return(tasks: Iterable[str], sources: Iterable[str]) -> bool:
    """Returns whether it is known of all tasks from which return they are solved.

    Args:
        tasks: of some configurations.
        sources: of the same configurations.
    """
    return FILE not in {*sources} and all(solved_return(task) is not None for task in {*tasks})


def has_return_range(tasks: Iterable[str], sources: Iterable[str]) -> bool:
    """Returns whether the returns of all tasks are from 0 to 1000; see `has_solved_return`."""
    return FILE not in {*sources} and all(return_range(task) is not None for task in {*tasks})
