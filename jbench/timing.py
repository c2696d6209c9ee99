"""Where the time of a training loop goes: the loops name their parts, and `measured` times them.

    with measured() as spent:
        train()
    print(spent["robots"])

The loops name `acting`, `robots`, `transitions`, `updates`, `waiting for updates` (of a GPU),
`rows`, `evaluation` and `checkpoints`.
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext


class _Clock:
    """Measures wall time in s by part, each without the parts inside it."""

    def __init__(self) -> None:
        """Has measured nothing yet."""
        self.spent: dict[str, float] = defaultdict(float)
        self._inside = [0.0]

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Adds the time of a block to its part, without that of the parts inside it."""
        self._inside.append(0.0)
        began = time.perf_counter()
        try:
            yield
        finally:
            whole = time.perf_counter() - began
            self.spent[name] += whole - self._inside.pop()
            self._inside[-1] += whole


_UNTIMED = nullcontext()
_clock: _Clock | None = None


def part(name: str) -> AbstractContextManager[None]:
    """Returns a block whose time is that of a part; it costs nothing if none is measured."""
    if _clock is None:
        return _UNTIMED
    return _clock.part(name)


@contextmanager
def measured() -> Iterator[dict[str, float]]:
    """Times the parts of all loops of this process during a block; yields seconds by part.

    A part that has not begun is 0. Blocks are not nested.
    """
    global _clock
    _clock = _Clock()
    try:
        yield _clock.spent
    finally:
        _clock = None
