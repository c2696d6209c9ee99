"""The runs that one side of a comparison chooses by its settings."""

import math
from collections.abc import Collection
from decimal import Decimal

import numpy as np
import pandas as pd

from jbench.array_types import BoolArray
from jbench.errors import RequestError
from jbench.report.data.code import recorded_code, split_by_code
from jbench.report.request import OF, representations_meant, setting, settings_typed
from jbench.settings.code_words import CODE_LENGTH, CODE_WORDS
from jbench.settings.labels import value_text
from jbench.settings.recorded import comparable, flatten, parse_run
from jbench.typed_values import closest


def have_settings(text: str, runs: pd.DataFrame) -> BoolArray:
    """Returns which runs have all of the typed settings, by any of the names of each.

    Raises a RequestError if no run has one of them.

    Args:
        text: settings with commas, as a side of `--compare` has them.
        runs: with the columns settings and provenance (as JSON) and created.
    """
    named = [_named_values(recorded) for recorded in runs["settings"]]
    have = np.ones(len(runs), bool)
    for part in settings_typed(text):
        name, value = setting(part)
        if not name or not (value or "=" in part):
            raise RequestError(
                f"--compare {text}: there is no such directory; type two results directories, or "
                "settings such as engine=sb3 engine=batched."
            )

        recorded = {shown for run in named for key, shown in run if key == name}
        if not recorded:
            raise _unknown(name, {key for run in named for key, _ in run})

        if name in CODE_WORDS and value.startswith(OF):
            have &= _have_code(value, runs, part)
            continue

        meant = _meant(name, value, recorded)
        if not meant:
            known = recorded
            if name in CODE_WORDS:
                known = {shown[:CODE_LENGTH] for shown in recorded if shown != "null"}
            raise RequestError(f"No run has {part}; there are {', '.join(sorted(known))}.")

        wanted = {(name, shown) for shown in meant}
        have &= [not wanted.isdisjoint(run) for run in named]

    return have


def _named_values(settings: str) -> set[tuple[str, str]]:
    """Returns the names and values of settings, as text.

    Each is named by its whole path, such as hyperparameters.tau, and by the last part of it.
    """
    values = set()
    for path, value in flatten(parse_run(settings)).items():
        shown = value_text(value)
        values |= {(path[-1], shown), (".".join(path), shown)}
    return values


def _unknown(name: str, known: Collection[str]) -> RequestError:
    """Returns the error for a setting that no run has; it lists the known names."""
    if not known:
        return RequestError(f"No run has a setting {name!r}: there are no runs.")

    # Only settings of the same name in two tables need the name of the table.
    short = [key for key in known if "." not in key or key.rpartition(".")[2] not in known]
    close = closest(name, sorted(known))
    others = "there are" if close is None else f"did you mean {close}? There are"
    return RequestError(f"No run has a setting {name!r}; {others} {', '.join(sorted(short))}.")


def _meant(name: str, typed: str, recorded: Collection[str]) -> list[str]:
    """Returns which of the recorded values of a setting a typed text means."""
    if name == "representation":
        return representations_meant(typed, recorded)
    if name in CODE_WORDS:
        return [shown for shown in recorded if shown.startswith(typed)]
    return [shown for shown in recorded if _equal(typed, shown)]


def _have_code(date: str, runs: pd.DataFrame, typed: str) -> BoolArray:
    """Returns which runs are of the code that names call by a date, such as `of 2026-11-28`."""
    described = runs[["created"]].assign(
        typed=runs["settings"].map(parse_run), code=runs["provenance"].map(recorded_code)
    )
    names = split_by_code(described, described["typed"].map(comparable), every=True)
    have = (names == f"code {date}").to_numpy(bool)
    if not have.any():
        known = sorted({*names} - {""})
        there = f"there are {', '.join(known)}" if known else "no code of yours is recorded"
        raise RequestError(f"No run has {typed}; {there}.")

    return have


def _equal(typed: str, value: str) -> bool:
    """Returns whether a typed text means a value, such as 1e-4 for 0.0001.

    The value is as `value_text` shows it: a whole number with all its digits, others with six.
    """
    try:
        number = Decimal(typed)
        shown = Decimal(value)
    except ArithmeticError:
        return typed.replace(" ", "") == value.replace(" ", "")

    are_whole = value.lstrip("-").isdecimal() and number == number.to_integral_value()
    return number == shown if are_whole else math.isclose(number, shown, rel_tol=1e-5)
