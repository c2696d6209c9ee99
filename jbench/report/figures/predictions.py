"""Figures of what latents predict: by their number, and against the returns of agents on them.

The measure is R²: the fraction of the variance of a quantity of the next control step that a small
network predicts from latents and action (`jbench.encoders.predictions`).
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from jbench.names import kind_of
from jbench.report.analysis.reduction import Group, Point
from jbench.report.figure import Axis, Figure, Panel, Series, Style
from jbench.report.figures import curve_series
from jbench.report.figures.encoders import (
    PREDICTED,
    by_task,
    column_of,
    encoder_name,
    latents_axis,
    look_of,
)

_NOTE = (
    "R² of a small network with fixed settings that predicts a quantity of the next control step "
    "from latents and action, on held-out episodes; medians across seeds. Values below 0 are drawn "
    "at 0."
)
_MIN_POINTS = 3
_UNIT = (-0.06, 1.06)  # with room for markers at 0 and 1


def prediction_figure(table: pd.DataFrame) -> Figure | None:
    """Returns the figure of R² against the number of latents, or None without measurements.

    Args:
        table: see `encoders.encoder_table`.
    """
    panels = [
        Panel(
            f"{task}: {name}",
            latents_axis(rows),
            Axis("R²", _UNIT),
            _latents_series(rows, quantity),
        )
        for task, rows in by_task(table[table["yaw_rate"].notna()]).items()
        for quantity, name in PREDICTED.items()
    ]
    return Figure("Predictions against number of latents", panels, (), [_NOTE]) if panels else None


def _latents_series(rows: pd.DataFrame, quantity: str) -> list[Series]:
    """Returns a series of R² for each variant of a kind of encoder."""
    series = []
    for (kind, settings), group in rows.groupby(["kind", "settings"], sort=False):
        color, marker = look_of(str(kind))
        r2 = np.maximum(column_of(group, quantity), 0)
        style = Style(color, marker=marker, size=5)
        name = encoder_name(kind, settings)
        series.append(Series(column_of(group, "latents"), r2, style, name))
    return series


def returns_figure(groups: Sequence[Group], table: pd.DataFrame) -> Figure | None:
    """Returns the figure of final returns against what latents predict, for groups with enough.

    Args:
        groups: groups of cells of one kind of return.
        table: see `encoders.encoder_table`.
    """
    measured = _by_representation(table)
    panels = []
    for group in groups:
        points = [p for p in group.points if (p.cell.task, p.cell.representation) in measured]
        if len(points) < _MIN_POINTS:
            continue
        y = curve_series.returns_axis(f"final {points[0].cell.kind.axis}")
        for quantity, name in PREDICTED.items():
            series = [
                _point(one, measured[one.cell.task, one.cell.representation][quantity])
                for one in points
            ]
            x = Axis(f"R² of the {name}", _UNIT)
            panels.append(Panel(f"{group.name}: {name}", x, y, series))
    if not panels:
        return None
    kind = groups[0].points[0].cell.kind
    note = (
        f"{kind.final} Points: interquartile means across seeds; bars: their 95% intervals. "
        f"{_NOTE} A relation between representations does not prove a cause."
    )
    return Figure(f"What latents predict, and final {kind.plural}", panels, (), [note])


def _by_representation(table: pd.DataFrame) -> dict[tuple[str, str], dict[str, float]]:
    """Returns the R² of each quantity by task and representation.

    Representations with several variants of an encoder are left out, because a cell does not say
    which of them its agents observe.
    """
    if table.empty:
        return {}
    keys = ["task", "representation"]
    rows = table.assign(representation=table["kind"] + table["latents"].astype(str))
    rows = rows[~rows.duplicated(keys, keep=False) & rows["yaw_rate"].notna()]
    return {
        (row["task"], row["representation"]): {name: row[name] for name in PREDICTED}
        for row in rows.to_dict("records")
    }


def _point(point: Point, r2: float) -> Series:
    color, marker = look_of(kind_of(point.cell.representation))
    return curve_series.mean_point(point, max(r2, 0.0), Style(color, "", marker=marker, size=6))
