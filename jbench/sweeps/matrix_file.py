"""Reads the file of a matrix, shipped or a user's, and its parts."""

import contextlib
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jbench.errors import RequestError
from jbench.names import SWEEPS, known

PART = "part"
"""Key of the parts, an array of tables."""

COMPARISON = "comparison"
"""Key of the comparisons of `--until-decided`, an array of tables."""


def read_content(name: str) -> dict[str, Any]:
    """Returns the content of a matrix's file.

    Args:
        name: one of `jbench.names.SWEEPS`, or the path of a .toml file.

    Raises:
        RequestError: if there is no such matrix, or it is not TOML.
    """
    text = _text(name)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also of thousands of digits
        raise RequestError(f"{name} is not TOML ({error}); docs/sweeps.md shows a file.") from None


def split_into_parts(content: Mapping[str, Any], name: str) -> dict[str, dict[str, Any]]:
    """Returns the parts of a matrix by their names in errors; without parts, the whole file.

    Keys outside the parts are defaults for all of them.

    Raises:
        RequestError: if the parts are not an array of tables.
    """
    defaults = {key: value for key, value in content.items() if key not in (PART, COMPARISON)}
    if PART not in content:
        return {name: defaults}
    parts = content[PART]
    tables = isinstance(parts, list) and all(isinstance(part, Mapping) for part in parts)
    if not tables or not parts:
        raise RequestError(f"{name}: {PART} is an array of tables: write [[{PART}]] above each.")
    return {f"{name}, part {n}": _merged(defaults, part) for n, part in enumerate(parts, 1)}


@contextlib.contextmanager
def named(name: str) -> Iterator[None]:
    """Puts the name of a file or a part in front of the refusals of the block."""
    try:
        yield
    except RequestError as error:
        raise RequestError(f"{name}: {error}") from None


def _merged(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns values completed by defaults, recursively."""
    merged = {**defaults, **values}
    for key in defaults.keys() & values.keys():
        if isinstance(defaults[key], Mapping) and isinstance(values[key], Mapping):
            merged[key] = _merged(defaults[key], values[key])
    return merged


def _text(name: str) -> str:
    if name in SWEEPS:
        return (resources.files("jbench.paper") / "matrices" / f"{name}.toml").read_text("utf-8")
    path = Path(name)
    if path.suffix != ".toml":
        try:
            known("matrix", name, SWEEPS)
        except RequestError as error:
            file = f"{name}.toml" if Path(f"{name}.toml").exists() else "a FILE.toml"
            raise RequestError(f"{str(error).rstrip('.')}; or type {file}.") from None
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise RequestError(f"{name} can't be read ({reason}).") from None
