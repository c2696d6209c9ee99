"""The values under the pointer: what the lines and heat maps of a figure hold, thinned."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.category import StrCategoryFormatter, StrCategoryLocator
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter
from numpy.typing import NDArray

from jbench.report.page.colors import both
from jbench.report.page.text import plain

POINTS = 400
"""Points of a line that the page keeps: about one for each pixel of a panel."""

PAGE_POINTS = 60_000
"""Points that a page keeps of all lines of all figures together, each about 30 bytes."""

CELLS = 10_000
"""Cells of the largest heat map whose values the page keeps."""

_DIGITS = 7  # significant, of each value

FloatArray = NDArray[np.float64]


def points_each(figures: Iterable[Figure]) -> int:
    """Returns how many points of each line a page of these figures keeps."""
    lines = sum(
        not str(line.get_label()).startswith("_")
        for figure in figures
        for axes in figure.axes
        for line in axes.lines
    )
    return max(2, min(POINTS, PAGE_POINTS // max(1, lines)))


def panels(figure: Figure, points: int = POINTS) -> list[dict[str, Any]]:
    """Returns the panels of a drawn figure that hold values, for `script.js`.

    Each has `title`; `box`, its left, top, right and lower edge in points of the SVG; `x` and `y`,
    its axes (see `_axis`); and `lines` (see `_lines`) or `grid` (see `_grid`).

    Args:
        figure: that was drawn, so that its axes have their places.
        points: the most that are kept of a line. Of a longer one every k-th is kept, and the last.
    """
    width, height = (72 * inches for inches in figure.get_size_inches())
    found = []
    for axes in figure.axes:
        lines, grid = _lines(axes, points), _grid(axes)
        if axes.get_label() == "<colorbar>" or not (lines or grid):
            continue
        box = axes.get_position()
        titles = (axes.get_title(loc) for loc in ("left", "center", "right"))
        found.append(
            {
                "title": plain(" ".join(filter(None, titles))),
                "box": [
                    round(number, 2)
                    for number in (
                        box.x0 * width,
                        (1 - box.y1) * height,
                        box.x1 * width,
                        (1 - box.y0) * height,
                    )
                ],
                "x": _axis(axes.xaxis, axes.get_xlim(), axes.get_xscale()),
                "y": _axis(axes.yaxis, axes.get_ylim(), axes.get_yscale()),
                "lines": lines,
                "grid": grid,
            }
        )
    return [panel for panel in found if panel["x"] and panel["y"]]


def _axis(axis: Axis, limits: tuple[float, float], scale: str) -> dict[str, Any] | None:
    """Returns the label, scale and limits of an axis; None where the scale is neither of two.

    `unit` is what a value is multiplied by to give what the axis says, such as 0.001 where it says
    thousands; `ticks` are the names of places where the ticks are names.
    """
    if scale not in ("linear", "log"):
        return None
    ticks = _tick_names(axis)
    return {
        "label": plain(axis.get_label_text()),
        "log": scale == "log",
        "limits": [float(limit) for limit in limits],
        "unit": 1.0 if ticks else _unit(axis, limits),
        "ticks": ticks,
    }


def _unit(axis: Axis, limits: tuple[float, float]) -> float:
    formatter = axis.get_major_formatter()
    if not isinstance(formatter, FuncFormatter):
        return 1.0
    value = max(limits, key=abs)
    try:
        return _rounded(float(formatter(value)) / value)
    except (ValueError, ZeroDivisionError):
        return 1.0


def _tick_names(axis: Axis) -> list[list[Any]] | None:
    formatter, locator = axis.get_major_formatter(), axis.get_major_locator()
    if not isinstance(formatter, FuncFormatter | FixedFormatter | StrCategoryFormatter):
        return None
    if not isinstance(locator, FixedLocator | StrCategoryLocator):
        return None
    places = [float(place) for place in locator()]
    return [[place, plain(formatter(place, i))] for i, place in enumerate(places)]


@dataclass
class _Line:
    """A line, or the outline of a histogram, and the areas drawn since the line before."""

    label: str
    color: str
    x: FloatArray
    y: FloatArray
    areas: list[PolyCollection]


def _lines(axes: Axes, points: int) -> list[dict[str, Any]]:
    """Returns the labelled lines of axes, and the outlines of histograms as lines.

    Each has `label`, `color`, `x`, `y`, and `bands`: the areas of its colour drawn since the line
    before, each a list of [low, high] or null for each point.
    """
    lines = []
    for line in _drawn_lines(axes):
        shown = np.flatnonzero(
            _can_be_shown(line.x, axes.get_xscale()) & _can_be_shown(line.y, axes.get_yscale())
        )
        if not shown.size:
            continue
        shown = thinned(shown, points)
        x = line.x[shown]
        lines.append(
            {
                "label": plain(line.label),
                "color": both(line.color),
                "x": [_rounded(value) for value in x],
                "y": [_rounded(value) for value in line.y[shown]],
                "bands": [list(_band(a, x)) for a in line.areas if _face(a) == line.color],
            }
        )
    return lines


def _drawn_lines(axes: Axes) -> list[_Line]:
    """Returns what has a label, in the order of drawing.

    A line without a label that follows one of the same colour and the same x fills its gaps:
    it is the same curve in another style.
    """
    lines: list[_Line] = []
    areas: list[PolyCollection] = []
    for artist in axes.get_children():
        if isinstance(artist, PolyCollection):
            areas.append(artist)
        # A line across the whole panel, such as a threshold, has no values of its own.
        if isinstance(artist, Line2D) and artist.get_transform() == axes.transData:
            color = _hex(artist.get_color())
            x, y = _filled(artist.get_xdata()), _filled(artist.get_ydata())
        elif isinstance(artist, Polygon) and len(artist.get_xy()) % 2 == 0:
            color = _hex(artist.get_edgecolor())
            x, y = _bins(np.asarray(artist.get_xy(), float))
        else:
            continue
        label = str(artist.get_label())
        if label and not label.startswith("_"):
            lines.append(_Line(label, color, x, y, areas))
            areas = []
        elif lines and lines[-1].color == color and np.array_equal(lines[-1].x, x):
            lines[-1].y = np.where(np.isnan(lines[-1].y), y, lines[-1].y)
    return lines


def _bins(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the middles and heights of the bins of a histogram's outline (`histtype="step"`)."""
    return (corners[1:-1:2, 0] + corners[2::2, 0]) / 2, corners[1:-1:2, 1]


def _can_be_shown(values: FloatArray, scale: str) -> NDArray[np.bool_]:
    shown: NDArray[np.bool_] = np.isfinite(values)
    return shown & (values > 0) if scale == "log" else shown


def thinned(indices: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Returns every k-th of these, and the last, so that there are `most` of them or fewer."""
    step = -(-(len(indices) - 1) // max(1, most - 1)) or 1
    return np.unique(np.r_[indices[::step], indices[-1]])


def _band(area: PolyCollection, x: FloatArray) -> Iterator[list[float] | None]:
    """Yields the lowest and highest y of an area at each of these x, or None beside it."""
    corners = np.concatenate([path.vertices for path in area.get_paths()] or [np.empty((0, 2))])
    places, index = np.unique(corners[:, 0], return_inverse=True)
    low, high = np.full(len(places), np.inf), np.full(len(places), -np.inf)
    np.minimum.at(low, index, corners[:, 1])
    np.maximum.at(high, index, corners[:, 1])
    at = np.searchsorted(places, x)
    for value, i in zip(x, at, strict=True):
        inside = i < len(places) and places[i] == value
        yield [_rounded(low[i]), _rounded(high[i])] if inside else None


def _face(area: PolyCollection) -> str | None:
    colors = area.get_facecolor()
    return _hex(colors[0]) if len(colors) else None


def _hex(color: Any) -> str:
    return to_hex(color)


def _grid(axes: Axes) -> dict[str, Any] | None:
    """Returns the heat map of axes: `x` and `y`, the edges of its cells, and rows of `values`."""
    for artist in (*axes.collections, *axes.images):
        if not isinstance(artist, QuadMesh | AxesImage):
            continue
        x, y = _edges(artist)
        values = _filled(artist.get_array())
        if values.size != (len(y) - 1) * (len(x) - 1) or values.size > CELLS:
            continue
        return {
            "label": plain(artist.colorbar.ax.get_ylabel() if artist.colorbar else ""),
            "x": [_rounded(value) for value in x],
            "y": [_rounded(value) for value in y],
            "values": [
                [_rounded(value) if np.isfinite(value) else None for value in row]
                for row in values.reshape(len(y) - 1, len(x) - 1)
            ],
        }
    return None


def _edges(heat_map: QuadMesh | AxesImage) -> tuple[FloatArray, FloatArray]:
    """Returns the edges of a heat map's columns, and of its rows in the order of its values."""
    if isinstance(heat_map, QuadMesh):
        corners = np.asarray(heat_map.get_coordinates(), float)
        return corners[0, :, 0], corners[:, 0, 1]
    left, right, bottom, top = heat_map.get_extent()
    rows, columns = np.shape(_filled(heat_map.get_array()))[:2]
    ends = (top, bottom) if heat_map.origin == "upper" else (bottom, top)
    return np.linspace(left, right, columns + 1), np.linspace(*ends, rows + 1)


def _filled(values: Any) -> FloatArray:
    """Returns values as numbers, and NaN where they are masked."""
    filled: FloatArray = np.ma.filled(np.ma.asarray(values, float), np.nan)
    return filled


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
