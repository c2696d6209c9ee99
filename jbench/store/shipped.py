"""The shipped results database: reference runs and some trained policies."""

from collections.abc import Collection
from functools import cache
from pathlib import Path

from jbench.errors import RequestError
from jbench.names import POLICY_FILES, REFERENCE, SHIPPED_RESULTS, is_reference
from jbench.store.database import Results

LEFT_OUT = (
    "is left out of the installed package; a checkout of jbench's repository has it: type "
    "--results CHECKOUT/results/reference"
)
"""Follows the name of a policy, or of several, in a sentence."""


def shipped() -> Path:
    """Returns the results directory in the package; it may not exist."""
    return SHIPPED_RESULTS


@cache
def kept_policies() -> frozenset[str]:
    """Returns the ids of the runs whose policies are in the wheel."""
    lines = Path(__file__).with_name("kept_policies.txt").read_text("utf-8").splitlines()
    return frozenset(line for line in lines if not line.startswith("#"))


def may_lack(id: str) -> Collection[str]:
    """Returns the files that a shipped record lacks in a wheel, and has in a checkout."""
    return () if id in kept_policies() else POLICY_FILES


def shipped_results() -> Results:
    """Returns the results in the package, which messages call `reference`."""
    return Results(shipped(), Path(REFERENCE), may_lack)


def results_to_read(place: Results | Path | str) -> Results:
    """Returns results; "reference" names the shipped ones. Raises a RequestError if none exist."""
    if isinstance(place, Results):
        return place

    path = Path(place)
    if is_reference(path):
        return shipped_results()

    if not path.exists():
        raise RequestError(
            f"{place} does not exist; name another directory, such as {REFERENCE} (the results "
            "shipped with jbench), or type jbench demo to make results."
        )

    return Results(path)


def results_to_write(path: Path) -> Results:
    """Returns results to write to, which need not exist; refuses the shipped ones, and files."""
    if is_reference(path):
        raise RequestError(
            f"{REFERENCE} names the results shipped with jbench, which are read-only; name another "
            "results directory."
        )
    return Results(path)
