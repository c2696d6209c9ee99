"""Remembers results of functions, for a program that repeats itself.

`jbench report --watch` writes a page again and again, of which little changes. Within
`remembering`, a function that is called with the same arguments as in the round before returns the
same result, which must not be modified.
"""

import contextlib
import dataclasses
import functools
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

from pydantic import BaseModel

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class Memory:
    """Results by the content of what they were computed from."""

    def __init__(self) -> None:
        self._before: dict[bytes, Any] = {}
        self._found: dict[bytes, Any] = {}

    def next_round(self) -> None:
        """Forgets results that were not used since the last call."""
        self._before, self._found = self._found, {}

    def recall(self, key: Any, make: Callable[[], Any]) -> Any:
        """Returns the result for a key: the one that was made for an equal key, if any.

        A result whose key has no hash is made each time.
        """
        try:
            name = content_hash(key)
        except TypeError:
            return make()
        for results in (self._found, self._before):
            if name in results:
                self._found[name] = results[name]
                return results[name]
        made = self._found[name] = make()
        return made


_memory: Memory | None = None


@contextlib.contextmanager
def remembering() -> Iterator[Memory]:
    """Remembers results of this process until the end of the block."""
    global _memory
    _memory = Memory()
    try:
        yield _memory
    finally:
        _memory = None


def recall(key: Any, make: Callable[[], _Result]) -> _Result:
    """Returns `make()`, or within `remembering` its result for an equal key; see `content_hash`."""
    result: _Result = make() if _memory is None else _memory.recall(key, make)
    return result


def remembered(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorates a function whose result depends only on its arguments; see `recall`."""

    @functools.wraps(function)
    def call(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        return recall((function, args, kwargs), lambda: function(*args, **kwargs))

    return call


def content_hash(value: Any) -> bytes:
    """Returns the SHA-256 of a value of arrays, dataclasses, settings, functions and containers.

    Raises:
        TypeError: if it contains a value of another type.
    """
    digest = hashlib.sha256()
    _feed(digest.update, value)
    return digest.digest()


def _feed(update: Callable[[bytes], None], value: Any) -> None:
    """Passes a value on as bytes; texts have their length, so that they can't be confused."""
    parts: list[Any] = []
    if value is None or isinstance(value, str | bytes | int | float | BaseModel):
        content = repr(value).encode(errors="backslashreplace")
    elif hasattr(value, "dtype") and not value.dtype.hasobject:
        content = value.tobytes()
        parts = [str(value.dtype), value.shape]
    elif isinstance(value, functools.partial):
        content, parts = b"", [value.func, value.args, value.keywords]
    elif callable(value) and "<" not in value.__qualname__:
        content = f"{value.__module__}.{value.__qualname__}".encode()
    elif dataclasses.is_dataclass(value):
        content, parts = b"", [getattr(value, one.name) for one in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        content, parts = b"", [*value.items()]
    elif isinstance(value, Sequence):
        content, parts = b"", [*value]
    else:
        raise TypeError(f"no hash of the content of a {type(value).__name__}")
    update(f"{type(value).__qualname__} {len(content)} {len(parts)} ".encode())
    update(content)
    for part in parts:
        _feed(update, part)
