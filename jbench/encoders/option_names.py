"""Options of an encoder as a part of its short name: noise-0.2 of dae12-noise-0.2.

Features of the observation, which are an option too, have a form of their own; see
`jbench.encoders.features`.
"""

import contextlib
import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from jbench.encoders.features import HASHED, from_name, shortest
from jbench.settings.base import settings_hash

SCALES = ("scale", "rescale")
"""Options of which a name has only the values, as its last parts: dae12-observation-whitened."""

_HASHED_OPTIONS = "options"  # word before the hash of options whose values are too long
_LONGEST = 60  # characters of options in a name
_OPTION = re.compile(r"-([a-z_]+)-([A-Za-z0-9_.]+)")


def options_in_name(options: Mapping[str, Any]) -> str:
    """Returns options as a part of a name: epochs-20-noise-0.2, or a hash of long ones."""
    name = "-".join(f"{option}-{_value_in_name(value)}" for option, value in options.items())
    if len(name) > _LONGEST:
        return f"{_HASHED_OPTIONS}-{settings_hash(options)}"
    return name


def options_from_name(match: re.Match[str], task: str) -> dict[str, Any] | None:
    """Returns the options in a name; None if they are a hash, whose encoder is found by the name.

    Args:
        match: of `REPRESENTATION` in the name.
        task: whose observation has the features in the name.

    Raises:
        RequestError: if the task has no such features.
    """
    options: dict[str, Any] = {scale: match[scale] for scale in SCALES if match[scale]}

    text = match["features"]
    if text:
        if text.startswith(f"{HASHED}-"):
            return None
        options["features"] = shortest(task, from_name(text, task))

    for name, value in _OPTION.findall(match["options"] or ""):
        if name == _HASHED_OPTIONS:
            return None
        options[name] = value
        if may_be_hash(value) and not value.isdecimal():
            continue  # 1234e567 is no number, since names have none with an exponent

        with contextlib.suppress(ValueError):
            options[name] = json.loads(value)

    return options


def may_be_hash(value: Any) -> bool:
    """Returns whether the value of an option in a name can be the hash of another value."""
    return re.fullmatch(r"[0-9a-f]{8}", str(value)) is not None


def as_typed(value: Any) -> str:
    """Returns the value of an option as users type it, without an exponent."""
    if isinstance(value, float):
        return np.format_float_positional(value, trim="-")
    if isinstance(value, str):
        return value
    return json.dumps(value)


def _value_in_name(value: Any) -> str:
    """Returns a value as a part of a name, or its hash if it has other letters."""
    text = as_typed(value)
    if re.fullmatch(r"[A-Za-z0-9_.]+", text):
        return text
    return settings_hash({"value": value})
