"""Results directories as users name them, and the shipped one: reference runs and policies."""

import os
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import get_args

from jbench.errors import RequestError
from jbench.names import POLICY_FILES, REFERENCE, SHIPPED_RESULTS, is_reference
from jbench.store.database import Results
from jbench.store.manifest import MANIFEST, RecordKind

_FOLDERS = [f"{kind}s" for kind in get_args(RecordKind)]

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

    _refuse_inside(path)
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

    _refuse_inside(path)
    return Results(path)


def _refuse_inside(path: Path) -> None:
    """Raises a RequestError for a directory of records, which names the results directory."""
    if not path.is_dir() or any((path / name).is_dir() for name in _FOLDERS):
        return

    # As typed: the results directory may be a link.
    absolute = Path(os.path.abspath(path))
    for up, folder in enumerate((absolute, *absolute.parents), 1):
        if folder.name in _FOLDERS and any(path.rglob(MANIFEST)):
            whole = os.path.normpath(path.joinpath(*[os.pardir] * up))
            raise RequestError(
                f"{path} is inside the results directory {whole}; type {whole} instead."
            )
