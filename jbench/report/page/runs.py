"""Runs of a page: their settings, thinned learning curves and paths as JSON."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jbench.report.data.paths import RunPath
from jbench.report.document import RunDetail
from jbench.report.page.text import plain
from jbench.report.page.tooltips import thinned

MAX_POINTS = 100
"""Maximum points of a curve."""

PAGE_POINTS = 20_000
"""Maximum points of all curves of a page, each about 6 bytes, and of all paths, about 11 bytes."""

_PATH_UNIT = 1e-4  # m


def packed(runs: Sequence[RunDetail]) -> dict[str, Any]:
    """Returns runs for the script, without repetitions.

    Keys: `runs`, each with its `name`, `cell` (a number), `settings` (indices), `curves` (label,
    index of the control steps, returns) and `paths` (see `_path`); `settings` (name and text each);
    and `steps`, the control steps that curves share.
    """
    count = sum(len(run.curves) for run in runs)
    most = max(2, min(MAX_POINTS, PAGE_POINTS // max(1, count)))
    of_path = max(2, PAGE_POINTS // max(1, sum(len(run.paths) for run in runs)))
    settings: dict[tuple[str, str], int] = {}
    steps: dict[tuple[int, ...], int] = {}
    cells: dict[tuple[str, str], int] = {}
    entries = []
    for run in runs:
        curves = []
        for curve in run.curves:
            shown = thinned(np.arange(len(curve.returns)), most)
            at = tuple(round(step) for step in curve.control_steps[shown].tolist())
            returns = [round(value, 1) for value in curve.returns[shown].tolist()]
            curves.append([plain(curve.label), steps.setdefault(at, len(steps)), returns])
        pairs = ((plain(name), plain(value)) for name, value in run.settings.items())
        entries.append(
            {
                "name": plain(run.name),
                "cell": cells.setdefault(run.cell, len(cells)),
                "settings": [settings.setdefault(pair, len(settings)) for pair in pairs],
                "curves": curves,
                "paths": [_path(path, of_path) for path in run.paths],
            }
        )
    return {"runs": entries, "settings": list(settings), "steps": list(steps)}


def _path(path: RunPath, most: int) -> list[Any]:
    """Returns control steps, return, x and y of each point in turn (0.1 mm), heading, and target.

    The target is x, y (m) and yaw (rad); unknown numbers are None.
    """
    shown = path.points[thinned(np.arange(len(path.points)), most)]
    points = [round(number) for number in (shown / _PATH_UNIT).ravel().tolist()]
    target = [round(value, 4) if np.isfinite(value) else None for value in path.target.tolist()]
    gained = round(path.episode_return, 1) if np.isfinite(path.episode_return) else None
    return [round(path.control_steps), gained, points, round(path.heading, 3), target]
