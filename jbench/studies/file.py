"""TOML files of studies, and refusals that name the place in a file."""

import contextlib
import tomllib
from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jbench.errors import RequestError
from jbench.names import SWEEPS
from jbench.typed_values import known

NULL = "null"
"""Text that means null, which TOML does not have."""


def read_file(name: str) -> dict[str, Any]:
    """Returns the content of a shipped file, by one of the names `SWEEPS`, or of a FILE.toml.

    `NULL` is None. Raises a RequestError if there is no such file, or it is not TOML.
    """
    path: Any = Path(name)
    if name in SWEEPS:
        path = resources.files("jbench.paper") / "matrices" / f"{name}.toml"
    elif not name.endswith(".toml"):
        file = f"{name}.toml" if Path(f"{name}.toml").exists() else "a FILE.toml"
        known("matrix", name, (*SWEEPS, file))

    try:
        content: dict[str, Any] = _with_nulls(tomllib.loads(path.read_text("utf-8")))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise RequestError(f"{name} can't be read ({reason}).") from None
    except (ValueError, RecursionError) as error:  # ValueError: also of thousands of digits
        raise RequestError(f"{name} is not TOML ({error}); docs/sweeps.md shows a file.") from None

    return content


def _with_nulls(value: Any) -> Any:
    """Returns a value of TOML in which each text `NULL` is None."""
    if isinstance(value, dict):
        return {name: _with_nulls(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_with_nulls(item) for item in value]
    return None if value == NULL else value


def tables(name: str, content: Mapping[str, Any], key: str) -> dict[str, dict[str, Any]]:
    """Returns the tables of an array of tables by names for errors; none without this key."""
    found = content.get(key, [])
    is_array = isinstance(found, list) and all(isinstance(table, dict) for table in found)
    if not is_array or (key in content and not found):
        raise RequestError(f"{name}: {key} is an array of tables: write [[{key}]] above each.")
    return {f"{name}, {key} {n}": table for n, table in enumerate(found, 1)}


@contextlib.contextmanager
def refusals_named(name: str) -> Iterator[None]:
    """Puts the name of a file or a part in front of the refusals of the block."""
    try:
        yield
    except RequestError as error:
        raise RequestError(f"{name}: {error}") from None
