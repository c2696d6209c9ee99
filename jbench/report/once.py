"""What is made of frames once, although the page, the files and the terminal show it."""

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from jbench.report.frames import Frames

_Made = TypeVar("_Made")


def once(make: Callable[[Frames], _Made]) -> Callable[[Frames], _Made]:
    """Returns a function that makes its result of the same frames once, and keeps it with them."""

    @wraps(make)
    def made(frames: Frames) -> _Made:
        if make not in frames.made:
            frames.made[make] = make(frames)
        result: _Made = frames.made[make]
        return result

    return made
