"""What must be closed although the object that would have closed it was never made."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Protocol, TypeVar

_Made = TypeVar("_Made")


class Closable(Protocol):
    """Something that holds threads, files or processes."""

    def close(self) -> object:
        """Releases them."""


@contextmanager
def closed_on_error(*owned: Closable) -> Iterator[None]:
    """Closes objects if the block raises an error; otherwise they stay open."""
    with called_on_error(*(each.close for each in owned)):
        yield


@contextmanager
def called_on_error(*closes: Callable[[], object]) -> Iterator[None]:
    """Calls functions, the last one first, if the block raises an error."""
    with ExitStack() as closing:
        for close in closes:
            closing.callback(close)
        yield
        closing.pop_all()


def make_all(
    count: int, make: Callable[[], _Made], close: Callable[[_Made], object]
) -> list[_Made]:
    """Returns objects of one kind; if one can't be made, those before it are closed."""
    objects = []
    with ExitStack() as closing:
        for _ in range(count):
            made = make()
            closing.callback(close, made)
            objects.append(made)
        closing.pop_all()
    return objects
