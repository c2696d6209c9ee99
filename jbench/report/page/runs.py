"""Runs of a page: their settings and thinned learning curves as JSON."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jbench.report.document import RunDetail
from jbench.report.page.text import plain
from jbench.report.page.values import thinned

MAX_POINTS = 100
"""Maximum points of a curve."""

PAGE_POINTS = 20_000
"""Maximum points of all curves of a page, each about 6 bytes."""


def packed(runs: Sequence[RunDetail]) -> dict[str, Any]:
    """Returns runs for the script, without repetitions.

    Keys: `runs`, each with its `name`, `cell` (a number), `settings` (indices) and `curves` (label,
    index of the control steps, returns); `settings` (name and text each); and `steps`, the control
    steps that curves share.
    """
    count = sum(len(run.curves) for run in runs)
    most = max(2, min(MAX_POINTS, PAGE_POINTS // max(1, count)))
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
            }
        )
    return {"runs": entries, "settings": list(settings), "steps": list(steps)}
