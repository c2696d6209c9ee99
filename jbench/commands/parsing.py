"""Parsing of option values: names, counts, seeds, settings and results directories."""

import contextlib
import json
import math
import re
from collections.abc import Collection, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import BadParameter

from jbench import names, typed_values
from jbench.commands import output
from jbench.errors import RequestError, WorkError
from jbench.representation_names import ENCODER_KINDS, FULL, NO_ENCODER, OFE, kind_in
from jbench.settings.algorithms import ALGORITHMS
from jbench.task_specs import GYM

if TYPE_CHECKING:
    from jbench.store import Results

_SCALES = {"k": 1000, "m": 1_000_000}


def known_or_held(setting: str, value: str, databases: Sequence["Results"]) -> str:
    """Returns the value of a setting if jbench knows it or a run of the results has it.

    jbench knows the tasks of other robots that it can use here. Raises a RequestError that lists
    the others if it is unknown.
    """
    known = _KNOWN[setting]
    name = value.lower()
    if setting == "representation" and kind_in(name) in known:
        return name
    if name in known:
        return name

    from jbench.store.listing import setting_values

    choices = {*known}
    for results in databases:
        choices |= setting_values(results, setting)

    if setting == "task" and value not in choices:
        from jbench.tasks.find import find_task

        with contextlib.suppress(RequestError, WorkError):
            return find_task(value).name

    return typed_values.known(_NOUNS[setting], value, sorted(choices))


_KNOWN = {
    "task": names.TASKS,
    "algo": ALGORITHMS,
    "representation": (FULL, OFE, *ENCODER_KINDS),
}
_NOUNS = {"task": "task", "algo": "algorithm", "representation": "representation"}


def run_filters(
    results: "Results", seed: str | None, status: names.Status | None, **typed: str | None
) -> dict[str, Collection[Any]]:
    """Returns the allowed values by field of a run's line; None allows every value.

    A representation is meant as by `representations_meant`. Raises a RequestError if a value is
    known neither to jbench nor to a run of the results.
    """
    from jbench.report.request import representations_meant
    from jbench.store.listing import setting_values

    filters = dict[str, Collection[Any]]()
    if status is not None:
        filters["status"] = [status]
    if seed is not None:
        filters["seed"] = typed_values.parse_numbers(seed, "--seed")

    for setting, value in typed.items():
        if value is None:
            continue

        meant = []
        if setting == "representation":
            held = setting_values(results, setting)
            meant = representations_meant(value, held)
            if value.lower() in NO_ENCODER:
                value = FULL

        filters[setting] = meant or [known_or_held(setting, value, [results])]

    return filters


def seeds(text: str) -> list[int]:
    """Returns the seeds of `--seeds`; prints a note if a number of seeds was probably meant."""
    numbers = typed_values.parse_numbers(text)
    typed = {"--seeds", f"--seeds={text}"} & set(output.typed)
    if typed and text.isdecimal() and numbers != [0]:
        (number,) = numbers
        instead = f"0-{number - 1} for {number} seeds"
        if number == 1:
            instead = "0 for one seed"
        output.say(f"Note: --seeds {text} is the seed {text} alone; type {instead}.")
    return numbers


def results_to_read(path: Path) -> "Results":
    """Returns results to read; see `jbench.store.shipped.results_to_read`."""
    from jbench.store.shipped import results_to_read

    return results_to_read(path)


def results_to_write(path: Path) -> "Results":
    """Returns results to write to; see `jbench.store.shipped.results_to_write`."""
    from jbench.store import shipped

    return shipped.results_to_write(path)


def writable(path: Path) -> Path:
    """Returns a results directory, or the default one in place of the shipped results."""
    if names.is_reference(path):
        return Path(names.RESULTS)
    return path


def path(text: str | Path) -> Path:
    """Returns a path as typed; an empty one, as of an unset shell variable, is refused.

    So is one of a home directory, which a shell puts in place of ~ at the beginning of a word only.
    """
    if not str(text):
        raise BadParameter("it is empty; type . for the working directory")

    path = Path(text)
    if path.parts[:1] == ("~",):
        raise BadParameter(f"{text}: your shell has left the ~ as it is; type {path.expanduser()}")
    return path


def count(text: str | int, least: int = 1, most: float = names.MAX_COUNT) -> int:
    """Returns a whole number, at least 0 or 1, typed as 5000000, 5_000_000, 5e6 or 5M."""
    typed = str(text)
    wanted = "a positive whole number"
    examples = "100000, 100k or 5e6"
    if least == 0:
        wanted = "a whole number"
        examples = "0, 200 or 10k"

    try:
        number = _scaled(typed)
    except ArithmeticError:
        number = Decimal(-1)

    if number.is_finite() and number > most:
        raise BadParameter(f"{typed!r}: type {wanted} up to {most}")
    if not (number.is_finite() and number >= least and number == number.to_integral_value()):
        raise BadParameter(f"{typed!r}: type {wanted}, such as {examples}")

    return int(number)


def _scaled(text: str) -> Decimal:
    """Returns the number of a text such as 5e6, 100k or 5M.

    Raises an ArithmeticError for another text, and for a number that decimal can't hold.
    """
    digits = text
    scale = 1
    if text[-1:].lower() in _SCALES:
        digits = text[:-1]
        scale = _SCALES[text[-1].lower()]

    return Decimal(digits) * scale


def number(text: str | float, least: float = -math.inf) -> float:
    """Returns a number, at least the given one; without one, also an infinity or NaN."""
    wanted = "a number"
    if least > -math.inf:
        wanted = f"a number of at least {least:g}"

    parsed: float | None = None
    with contextlib.suppress(ValueError):
        parsed = float(text)

    if parsed is None or (least > -math.inf and not least <= parsed < math.inf):
        raise BadParameter(f"{str(text)!r}: type {wanted}, such as 0.1, 60 or 5e-4")

    return parsed


def parse_overrides(assignments: list[str]) -> dict[str, Any]:
    """Returns the values of `tau=0.005` or `hidden_layers=64,64` by name, each given once."""
    overrides: dict[str, Any] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals or not name or name in overrides:
            raise RequestError(
                f"--set {assignment}: type each setting once, as NAME=VALUE, like --set tau=0.005."
            )

        overrides[name] = _value(text)

    return overrides


def comma_separated(text: str | None) -> list[str]:
    """Returns the names in a text such as face_direction,dae12; none for None."""
    if text is None:
        return []
    return [name.strip() for name in text.split(",")]


def names_of_matrix(text: str | None) -> list[str]:
    """Returns the names in a text such as gym:Hopper-v5,frame_skip=2,td3; none for None.

    The arguments of `gymnasium.make` are part of the task's name.
    """
    found: list[str] = []
    for name in comma_separated(text):
        if "=" in name and found and found[-1].startswith(GYM):
            found[-1] += f",{name}"
        else:
            found.append(name)

    return found


def _value(text: str) -> Any:
    """Returns a value of `--set`: a number such as 1k, JSON, a list without brackets, or text."""
    if re.fullmatch(r"\d+(\.\d+)?[kKmM]", text):
        number = _scaled(text)
        if number % 1:
            return text
        return int(number)

    with contextlib.suppress(ValueError):  # also of thousands of digits
        return json.loads(text)
    if "," in text:
        with contextlib.suppress(ValueError):
            return json.loads(f"[{text}]")

    return text


def state_to_keep(whole: bool, compact: bool) -> names.KeepState:
    """Returns what is kept of finished runs' states; both is a RequestError."""
    if whole and compact:
        raise RequestError(
            "A state is kept whole or compact: type --keep-state or --keep-compact-state, not both."
        )
    if compact:
        return "compact"
    if whole:
        return "whole"
    return "no"
