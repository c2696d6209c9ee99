"""What is installed: entry points, and the distributions of each package.

To read it takes a fifth of a second. It is read again after an installation, and after a change of
`sys.path` to or from a directory in which something is installed.
"""

import os
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, distributions, entry_points, packages_distributions
from pathlib import Path

_Places = tuple[tuple[str, int], ...]
"""Directories of installed distributions, in the order of `sys.path`, and when they changed."""


def packages() -> Mapping[str, list[str]]:
    """Returns the distributions of each top-level package that `sys.path` now finds."""
    return _packages(_places())


def offered(group: str) -> list[EntryPoint]:
    """Returns the entry points of a group that `sys.path` now finds."""
    return _entry_points(_places()).get(group, [])


def _places() -> _Places:
    """Returns where distributions are; the working directory has none, for most users."""
    places = [entry or os.getcwd() for entry in sys.path]
    return tuple((place, _changed(place)) for place in places if any(distributions(path=[place])))


def _changed(place: str) -> int:
    """Returns when a directory or file changed, in nanoseconds."""
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


@cache
def _packages(_places: _Places) -> Mapping[str, list[str]]:
    """Returns the distributions of each package; the places are the cache's key."""
    return packages_distributions()


@cache
def _entry_points(_places: _Places) -> Mapping[str, list[EntryPoint]]:
    """Returns all entry points by group; the places are the cache's key."""
    found = entry_points()
    return {group: list(found.select(group=group)) for group in found.groups}
