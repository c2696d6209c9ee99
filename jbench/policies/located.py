"""Runs whose policies are meant by a name: those of the results, and those shipped with jbench."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import NamedTuple

from jbench.errors import RequestError
from jbench.names import REFERENCE
from jbench.store import Results
from jbench.store.rows import has_policy
from jbench.store.shipped import LEFT_OUT, shipped_results
from jbench.typed_values import shown_as

SHIPPED = f"{REFERENCE}/"
"""Prefix of the names of shipped policies; the id of the run follows."""

_LISTED = 8  # names in a message


def shipped_policies() -> list[str]:
    """Returns the names of all policies shipped with jbench."""
    runs = shipped_results().scan("run")[0]
    return sorted(f"{SHIPPED}{run.id}" for run in runs if has_policy(run))


class LocatedRun(NamedTuple):
    """The run of a policy: the results that hold it, and its whole id."""

    results: Results
    id: str


def locate_run(results: Results, name: str) -> LocatedRun:
    """Returns the run of a policy.

    The name is the beginning of an id, after "reference/" for a shipped run.

    Raises a RequestError if the name is no id, or that of no shipped policy or of several runs.
    """
    if not name.startswith(SHIPPED):
        return LocatedRun(results, results.complete_id("run", name))

    names = shipped_policies()
    matches = [shipped for shipped in names if shipped.startswith(name)] or shown_as(name, names)
    if len(matches) == 1:
        return LocatedRun(shipped_results(), matches[0].removeprefix(SHIPPED))

    if matches:
        raise RequestError(
            f"{name} is not unique; type one of {_listed(matches)} "
            "(jbench runs --results reference shows how they differ)."
        )

    runs = shipped_results().scan("run", name.removeprefix(SHIPPED))[0]
    if any(run.left_out for run in runs):
        raise RequestError(f"The policy of {name} {LEFT_OUT}.")

    if not names:
        raise RequestError(f"No policy is shipped as {name}; this version of jbench ships none.")

    same = [shipped for shipped in names if shipped.startswith(f"{name.rpartition('/')[0]}/")]
    choices = same or sorted(get_close_matches(name, names, 3)) or names
    raise RequestError(f"No policy is shipped as {name}; type one of {_listed(choices)}.")


def _listed(names: Sequence[str]) -> str:
    """Returns names for a sentence, the first ones of many."""
    if len(names) <= _LISTED:
        return ", ".join(names)
    return f"{', '.join(names[:_LISTED])} or {len(names) - _LISTED:,} others"
