"""The file of a matrix: shipped or a user's own, and the parts that it consists of."""

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jbench import names
from jbench.errors import RequestError
from jbench.names import SWEEPS

PART = "part"
"""The key of the parts, which are an array of tables."""


def read_content(name: str) -> dict[str, Any]:
    """Returns what the file of a matrix contains.

    Args:
        name: one of `jbench.names.SWEEPS`, or the path of a file that ends in .toml.

    Raises:
        RequestError: if there is no such matrix, or it is not TOML.
    """
    try:
        return tomllib.loads(_text(name))
    except tomllib.TOMLDecodeError as error:
        raise RequestError(f"{name} is not TOML ({error}); docs/sweeps.md shows a file.") from None


def parts_of(content: Mapping[str, Any], name: str) -> dict[str, dict[str, Any]]:
    """Returns the parts of a matrix by what an error calls them; without parts, the whole file.

    The keys beside the parts are defaults of all of them.

    Raises:
        RequestError: if the parts are no array of tables.
    """
    defaults = {key: value for key, value in content.items() if key != PART}
    if PART not in content:
        return {name: defaults}
    parts = content[PART]
    tables = isinstance(parts, list) and all(isinstance(part, Mapping) for part in parts)
    if not tables or not parts:
        raise RequestError(f"{name}: {PART} is an array of tables: write [[{PART}]] above each.")
    return {f"{name}, part {n}": _merged(defaults, part) for n, part in enumerate(parts, 1)}


def _merged(defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns values with defaults where there are none, in tables within tables as well."""
    merged = {**defaults, **values}
    for key in defaults.keys() & values.keys():
        if isinstance(defaults[key], Mapping) and isinstance(values[key], Mapping):
            merged[key] = _merged(defaults[key], values[key])
    return merged


def _text(name: str) -> str:
    if name in SWEEPS:
        return (resources.files("jbench.paper") / "matrices" / f"{name}.toml").read_text()
    path = Path(name)
    if path.suffix != ".toml":
        try:
            names.known("matrix", name, SWEEPS)
        except RequestError as error:
            raise RequestError(f"{str(error).rstrip('.')}; or type a FILE.toml.") from None
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        raise RequestError(f"{name} can't be read ({reason}).") from None
