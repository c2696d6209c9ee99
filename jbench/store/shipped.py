"""The shipped results database: reference runs and some trained policies."""

from importlib import resources
from pathlib import Path

from jbench.errors import RequestError
from jbench.names import REFERENCE, is_reference
from jbench.store.database import Results


def shipped() -> Path:
    """Returns the results directory in the package; it may not exist."""
    return Path(str(resources.files("jbench").joinpath(REFERENCE)))


def shipped_results() -> Results:
    """Returns the results in the package, which messages call `reference`."""
    return Results(shipped(), Path(REFERENCE))


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
