"""Selects runs by settings that a user types for a side of a comparison."""

import math
from collections.abc import Callable, Collection

from jbench.errors import RequestError
from jbench.report.data.configuration import shown_representation
from jbench.report.request import setting
from jbench.settings.alike import flatten
from jbench.settings.recorded import Run
from jbench.settings.variants import value_text


def choose(text: str, runs: Collection[Run]) -> Callable[[Run], bool]:
    """Returns a function that selects runs by the typed settings.

    Raises:
        RequestError: if the text contains no settings, or no run has them.
    """
    typed = {part: setting(part) for part in map(str.strip, text.split(","))}
    for part, (name, value) in typed.items():
        if not name or "=" not in part:
            named = {path[-1] for run in runs for path, v in _texts(run) if v == part}
            example = f"{min(named)}={part}" if named else "engine=sb3 engine=batched"
            raise RequestError(
                f"--compare {text}: there is no such directory; type two results directories, or "
                f"settings such as {example}."
            )
        existing = {v for run in runs for path, v in _texts(run) if _names(path, name)}
        if not existing:
            names = sorted({".".join(path) for run in runs for path, _ in _texts(run)})
            raise RequestError(f"No run has a setting {name!r}; there are {', '.join(names)}.")
        if not any(_equal(value, recorded) for recorded in existing):
            known = ", ".join(sorted(existing))
            raise RequestError(f"No run has {part}; there are {known}.")
    return lambda run: all(
        any(_names(path, name) and _equal(value, recorded) for path, recorded in _texts(run))
        for name, value in typed.values()
    )


def _texts(run: Run) -> list[tuple[tuple[str, ...], str]]:
    """Returns the settings of a run as texts, by their paths."""
    return [(path, value_text(value)) for path, value in flatten(run).items()]


def _names(path: tuple[str, ...], name: str) -> bool:
    """Returns whether a name is that of a setting, which may be the last part of its path."""
    return name in (path[-1], ".".join(path))


def _equal(typed: str, value: str) -> bool:
    """Returns whether a typed text means a value, such as 1e-4 for 0.0001, planar for planar12."""
    try:
        return math.isclose(float(typed), float(value), rel_tol=1e-5)
    except ValueError:
        return typed.replace(" ", "") in (value.replace(" ", ""), shown_representation(value))
