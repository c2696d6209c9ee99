"""Reading what users type: names, counts, seeds, settings and results directories."""

import difflib
import json
import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jbench.errors import RequestError
from jbench.names import ENCODER_KINDS, FULL, LARGEST_SEED, OFE, REFERENCE

if TYPE_CHECKING:
    from jbench.store import Results


def known_or_held(
    setting: str, value: str, names: Collection[str], places: Sequence["Results"]
) -> str:
    """Returns the value if it is a name of jbench, or a run of the results has it.

    Args:
        setting: of runs: `task`, `algo` or `representation`.
        value: that was typed.
        names: that jbench has for it.
        places: results whose runs may have other names.

    Raises:
        RequestError: if nobody has it; it says what the runs have.
    """
    if value in names or (setting == "representation" and _is_representation(value)):
        return value
    from jbench.store.listing import values_of

    held = sorted({one for place in places for one in values_of(place, setting)})
    if value in held:
        return value
    close = difflib.get_close_matches(value, sorted({*held, *names}), 1)
    what = "algorithm" if setting == "algo" else setting
    where = " and ".join(str(place.path) for place in places)
    there = f"the runs in {where} have {', '.join(held)}" if held else f"{where} has no runs"
    hint = f"did you mean {close[0]}? {there[0].upper()}{there[1:]}" if close else there
    raise RequestError(f"Unknown {what} {value!r}; {hint}.")


def _is_representation(value: str) -> bool:
    """Returns whether a value is full, or a kind of ours with its size, as dae12 or ofe12."""
    found = re.fullmatch(r"([a-z-]+)[0-9]+", value)
    return value == FULL or (found is not None and found[1] in {*ENCODER_KINDS, OFE})


def is_reference(path: Path) -> bool:
    """Returns whether `--results` names the shipped results: not if there is such a directory."""
    return path == Path(REFERENCE) and not path.exists()


def results_at(path: Path) -> "Results":
    """Returns the results to read, which need not exist; `reference` names the shipped ones.

    Raises:
        RequestError: if the path is something other than a directory.
    """
    from jbench.store import Results
    from jbench.store.shipped import shipped

    return Results(shipped() if is_reference(path) else path)


def existing_results(path: Path) -> "Results":
    """Returns results to read; `reference` names the shipped ones.

    Raises:
        RequestError: if there is no such directory.
    """
    found = results_at(path)
    if not found.path.exists():
        raise RequestError(f"{path} does not exist; name a directory with --results.")
    return found


def results_to_write(path: Path) -> "Results":
    """Returns results to write to, which need not exist yet.

    Raises:
        RequestError: if they are the shipped ones, or the path is something other than a directory.
    """
    from jbench.store import Results

    if is_reference(path):
        raise RequestError(
            f"{REFERENCE} names the results shipped with jbench, which are read-only; name another "
            "directory with --results."
        )
    return Results(path)


def count(option: str, text: str) -> int:
    """Returns a positive whole number typed as 5000000, 5_000_000 or 5e6.

    Raises:
        RequestError: if it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = 0.5
    if not (number >= 1 and number.is_integer() and number <= 1e15):
        raise RequestError(f"{option} {text}: type a positive whole number, such as 100000 or 5e6.")
    return int(number)


def seed(number: int) -> int:
    """Returns a seed.

    Raises:
        RequestError: if it is negative, or larger than the database can keep.
    """
    if not 0 <= number <= LARGEST_SEED:
        raise RequestError(f"--seed {number}: type a whole number from 0 up to {LARGEST_SEED}.")
    return number


def augmented(number: int | None) -> int | None:
    """Returns the seed of an augmented robot, if one was asked for.

    Raises:
        RequestError: if it is negative.
    """
    if number is not None and not 0 <= number <= LARGEST_SEED:
        raise RequestError(f"--augment {number}: type a whole number from 0 up to {LARGEST_SEED}.")
    return number


def parse_overrides(assignments: list[str]) -> dict[str, Any]:
    """Returns the values by name of texts like `tau=0.005`, `hidden_layers=[64,64]`.

    Raises:
        RequestError: if one is not of the form NAME=VALUE, or a name comes twice.
    """
    overrides: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals or not name or name in overrides:
            raise RequestError(
                f"--set {assignment}: type each setting once, as NAME=VALUE, like --set tau=0.005."
            )
        try:
            overrides[name] = json.loads(text)
        except json.JSONDecodeError:
            overrides[name] = text
    return overrides


def all_cores(wanted: int) -> int:
    """Returns how many to run at a time: as many as wanted, or for 0 one on each core.

    Raises:
        RequestError: if it is negative.
    """
    from jbench.store.provenance import cores

    if wanted < 0:
        raise RequestError(f"{wanted} at a time can't be; type 0 for one on each core.")
    return wanted or cores()
