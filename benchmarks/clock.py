"""Measures the time of single methods in a running program."""

import time
from typing import Any

from jbench.agents.engine import Engine


class Clock:
    """Measures the wall time of methods, each without the measured methods that it calls.

    Attributes:
        spent: seconds by the name of the part.
    """

    def __init__(self) -> None:
        """Starts without a method."""
        self.spent: dict[str, float] = {}
        self._inside = [0.0]

    def reset(self) -> None:
        """Resets the measured times."""
        self.spent = dict.fromkeys(self.spent, 0.0)

    def watch(self, owner: Any, method: str, part: str) -> None:
        """Replaces a method of an object or a class by one that also measures its time."""
        function = getattr(owner, method)
        self.spent.setdefault(part, 0.0)

        def watched(*arguments: Any) -> Any:
            self._inside.append(0.0)
            began = time.perf_counter()
            result = function(*arguments)
            whole = time.perf_counter() - began
            self.spent[part] += whole - self._inside.pop()
            self._inside[-1] += whole
            return result

        setattr(owner, method, watched)

    def watch_loop(self, engine: Engine) -> None:
        """Measures the parts of an engine's loop."""
        self.watch(engine.environments, "step", "robots")
        self.watch(engine, "_explore_actions", "acting")
        self.watch(engine, "_store", "transitions")
        self.watch(engine, "_update", "updates")
        # On a GPU, updates only begin in `_update`, and `_learn` waits for them.
        self.watch(engine, "_learn", "waiting for updates")
