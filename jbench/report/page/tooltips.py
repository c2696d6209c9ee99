"""Values for the tooltips of figures: thinned series and heat maps as JSON."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from jbench.report.data.curves import BoolArray, FloatArray
from jbench.report.figure import Axis, Figure, HeatMap, Panel, Series
from jbench.report.page.colors import both
from jbench.report.page.text import plain

MAX_POINTS = 400
"""Maximum points of a series: about one per pixel of a panel."""

PAGE_POINTS = 60_000
"""Maximum points of all series of a page, each about 30 bytes."""

MAX_CELLS = 10_000
"""Maximum cells of a heat map with values."""

_DIGITS = 7  # significant digits


class Edges(NamedTuple):
    """Edges of a rectangle, in points from the upper left corner of the SVG."""

    left: float
    top: float
    right: float
    bottom: float


def points_each(figures: Iterable[Figure]) -> int:
    """Returns the maximum number of points per series for a page with these figures."""
    series = sum(
        _has_values(s) for figure in figures for panel in figure.panels for s in panel.series
    )
    return max(2, min(MAX_POINTS, PAGE_POINTS // max(1, series)))


def panels(
    figure: Figure, boxes: Sequence[Edges], points: int = MAX_POINTS
) -> list[dict[str, Any]]:
    """Returns the panels that have values, for the script.

    Each has `title`, `box`, its axes `x` and `y`, and `lines` and `grid`, one of which is empty.

    Args:
        points: maximum points of a series; a longer one is reduced to every k-th and the last.
    """
    described = [
        {
            "title": plain(panel.title),
            "number": number,
            "box": [round(edge, 2) for edge in box],
            "x": _axis(panel.x),
            "y": _axis(panel.y),
            "lines": _lines(panel, points, entries),
            "grid": _grid(panel.heat_map),
        }
        for number, (panel, entries, box) in enumerate(
            zip(figure.panels, figure.entry_numbers, boxes, strict=True)
        )
    ]
    return [panel for panel in described if panel["lines"] or panel["grid"]]


def thinned(indices: NDArray[np.intp], max_points: int) -> NDArray[np.intp]:
    """Returns every k-th index and the last, at most `max_points` of them."""
    step = -(-(len(indices) - 1) // max(1, max_points - 1)) or 1
    return np.unique(np.r_[indices[::step], indices[-1]])


def _axis(axis: Axis) -> dict[str, Any]:
    """Returns an axis: `ticks` are positions with their names, `unit` is that of `Axis`.

    `opposite` is the factor of values on a second scale, if there is one.
    """
    names = None if axis.names is None else [plain(name) for name in axis.names]
    return {
        "label": plain(axis.label),
        "log": axis.log,
        "limits": [float(limit) for limit in axis.limits],
        "unit": axis.unit,
        "opposite": axis.opposite and axis.opposite[1],
        "ticks": names and [list(tick) for tick in zip(axis.ticks or (), names, strict=True)],
    }


def _has_values(series: Series) -> bool:
    return bool(series.label or series.detail)


def _lines(panel: Panel, points: int, entries: Sequence[Sequence[int]]) -> list[dict[str, Any]]:
    """Returns the series with a label or a detail.

    Each has `label`, `color`, `x`, `y`, `bands` (a list of [low, high], or null, for each point),
    `of` (its entries of the legend by number) and `tags`.
    """
    lines = []
    for series, of in zip(panel.series, entries, strict=True):
        shown = np.flatnonzero(_on_axis(series.x, panel.x) & _on_axis(series.y, panel.y))
        if _has_values(series) and shown.size:
            lines.append({**_line(series, thinned(shown, points)), "of": of})
    return lines


def _line(series: Series, shown: NDArray[np.intp]) -> dict[str, Any]:
    bands = [(_numbers(band.low[shown]), _numbers(band.high[shown])) for band in series.bands]
    label = f"{series.label} ({series.detail})" if series.label and series.detail else ""
    return {
        "label": plain(label or series.label or series.detail),
        "color": both(to_hex(series.style.color)),
        "x": _numbers(series.x[shown]),
        "y": _numbers(series.y[shown]),
        "bands": [
            [None if low is None else [low, high] for low, high in zip(*band, strict=True)]
            for band in bands
        ],
        "tags": {name: plain(value) for name, value in series.tags.items()},
    }


def _on_axis(values: FloatArray, axis: Axis) -> BoolArray:
    """Returns whether values are finite, and on a logarithmic axis positive."""
    shown: BoolArray = np.isfinite(values) & ((values > 0) | (not axis.log))
    return shown


def _grid(heat_map: HeatMap | None) -> dict[str, Any] | None:
    """Returns a heat map: `label`, the edges `x` and `y` of its cells, and rows of `values`."""
    if heat_map is None or heat_map.values.size > MAX_CELLS:
        return None
    return {
        "label": plain(heat_map.label),
        "x": _numbers(heat_map.x),
        "y": _numbers(heat_map.y),
        "values": [_numbers(row) for row in heat_map.values],
    }


def _numbers(values: FloatArray) -> list[float | None]:
    """Returns rounded numbers; None for NaN."""
    return [
        float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()
    ]
