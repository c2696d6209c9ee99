"""Draws the panels of figures with matplotlib."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from jbench.report.figure import DOTS, Axis, HeatMap, Panel, Series, Style
from jbench.report.figures import heat_map_layout, layout, texts
from jbench.report.figures.layout import Place, Sheet
from jbench.report.figures.texts import SMALL

SERIES = "series"
"""Prefix of the ids of the SVG elements of series; the panel and the series' number follow."""

_PICTURE_CELLS = 1000  # larger heat maps are rasterized: each cell would be a path of 200 bytes
_INTERVAL_ALPHA = 0.18
_DECADES = 3  # logarithmic axes over fewer decades have ticks at 1, 2 and 5
_NARROW = 1.6  # inches; panels with fewer numbers on their axis
_ARROW = {"arrowstyle": "->", "color": "#d00000", "linewidth": 1.6}


def draw_panel(
    axes: Axes,
    panel: Panel,
    number: int,
    sheet: Sheet,
    place: Place | None = None,
    *,
    shared: bool = False,
    picture: bool = False,
) -> None:
    """Draws a panel.

    Args:
        number: its index in the figure.
        place: its place; None if matplotlib lays out the figure.
        shared: whether only the first panel of a row has numbers on its vertical axis.
        picture: whether to rasterize lines and areas in SVG and PDF files.
    """
    _style_panel(axes, panel, sheet, place, shared=shared)
    if panel.heat_map is not None:
        _draw_heat_map(axes, panel, panel.heat_map, sheet)
    for reference in panel.references:
        vertical, style = reference.vertical, reference.style
        (axes.axvline if vertical else axes.axhline)(reference.at, **look(style))
        if reference.interval is not None:
            span = axes.axvspan if vertical else axes.axhspan
            span(*reference.interval, color=style.color, alpha=_INTERVAL_ALPHA, lw=0)
    for i, series in enumerate(panel.series):
        for j, artist in enumerate(_draw_series(axes, series, picture=picture)):
            artist.set_gid(f"{SERIES}-{number}-{i}-{j}")
    if panel.arrow is not None:
        start, end = panel.arrow
        axes.annotate("", end, start, arrowprops=_ARROW)
    if panel.text:
        middle = axes.transAxes
        axes.text(0.5, 0.5, panel.text, transform=middle, ha="center", color="0.4", fontsize=SMALL)


def _draw_series(axes: Axes, series: Series, *, picture: bool) -> list[Artist]:
    style, x = series.style, series.x
    drawn: list[Artist] = []
    for band in series.bands:
        if band.bars:
            lines = axes.hlines if band.along_x else axes.vlines
            at = series.y if band.along_x else x
            drawn.append(lines(at, band.low, band.high, colors=style.color, lw=style.width))
        else:
            area: dict[str, Any] = {"color": style.color, "alpha": band.alpha, "lw": 0}
            drawn.append(axes.fill_between(x, band.low, band.high, rasterized=picture, **area))
    more: dict[str, Any] = {"zorder": series.zorder, "rasterized": picture}
    if series.edges is not None:
        stairs = axes.stairs(series.y, series.edges, color=style.color, lw=style.width, **more)
        return [*drawn, stairs]
    incomplete = np.zeros(len(x), bool) if series.partial is None else series.partial
    drawn += axes.plot(x, np.where(incomplete, np.nan, series.y), **look(style), **more)
    if incomplete.any():
        # Dotted parts include the neighboring solid points, so that there are no gaps.
        dotted = incomplete | np.r_[incomplete[1:], False] | np.r_[False, incomplete[:-1]]
        y = np.where(dotted, series.y, np.nan)
        drawn += axes.plot(x, y, color=style.color, ls=DOTS, lw=style.width, **more)
    return drawn


def _draw_heat_map(axes: Axes, panel: Panel, heat_map: HeatMap, sheet: Sheet) -> None:
    axes.pcolormesh(
        heat_map.x,
        heat_map.y,
        np.ma.masked_invalid(heat_map.values),
        norm=norm_of(heat_map),
        cmap="viridis",
        rasterized=heat_map.values.size > _PICTURE_CELLS,
    )
    if heat_map.is_map:
        axes.set_aspect("equal")
        return
    axes.set_facecolor("0.93")
    axes.patch.set(hatch="////", edgecolor="0.75")
    size, _ = heat_map_layout.table_texts(panel, sheet)
    for cell in heat_map.texts:
        left, right = heat_map.x[cell.column : cell.column + 2]
        top, bottom = heat_map.y[cell.row : cell.row + 2]
        if cell.framed:
            sides = (left, top), right - left, bottom - top
            axes.add_patch(Rectangle(*sides, facecolor="white", edgecolor="0.6", linewidth=0.6))
        middle = (left + right) / 2, (top + bottom) / 2
        axes.text(*middle, cell.text, ha="center", va="center", color=cell.color, fontsize=size)


def _style_panel(
    axes: Axes, panel: Panel, sheet: Sheet, place: Place | None, *, shared: bool
) -> None:
    """Sets title, axes and grid of a panel."""
    if panel.title:
        if place is None:
            title = texts.in_lines(panel.title, heat_map_layout.title_characters(sheet))
            size, weight = SMALL, "normal"
        else:
            title, size, weight = place.title, place.title_size, "bold"
        # Only a second axis above moves a title. Without y, matplotlib would measure all labels.
        y = None if panel.x.opposite else 1.0
        axes.set_title(title, loc="left", y=y, parse_math=False, fontsize=size, fontweight=weight)
    axes.tick_params(labelsize=tick_size(panel, sheet))
    narrow = place is not None and place.box.width < _NARROW
    x_label = panel.x.label if place is None else place.x_label
    y_label = panel.y.label if place is None or place.first else ""
    name_size = layout.ROW_NAME if place is None else place.name_size
    if panel.heat_map is not None and panel.y.names:
        _, name_size = heat_map_layout.table_texts(panel, sheet)
    _style_axis(axes, "x", panel.x, x_label, layout.COLUMN_NAME, narrow=narrow)
    _style_axis(axes, "y", panel.y, y_label, name_size)
    _fit_names(axes, panel.x.names or (), place)
    if shared and place is not None and not place.first:
        axes.tick_params(labelleft=False)
    if panel.heat_map is None:
        axes.grid(color="0.92", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        if panel.y.names is not None:
            axes.spines["left"].set_visible(False)
            axes.tick_params(axis="y", length=0)
    elif not panel.heat_map.is_map:
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)


def _fit_names(axes: Axes, names: Sequence[str], place: Place | None) -> None:
    """Makes names below a panel smaller or slanted where they would overlap."""
    slanted = len(names) > 1
    if place is not None and names:
        fitting = texts.size_side_by_side(names, place.box.width)
        slanted = fitting is None
        axes.tick_params(axis="x", labelsize=fitting or SMALL)
    for label in axes.get_xticklabels() if slanted else ():
        label.set(rotation=texts.SLANT, ha="right")


def _style_axis(
    axes: Axes,
    name: str,
    axis: Axis,
    label: str,
    name_size: tuple[int, int],
    *,
    narrow: bool = False,
) -> None:
    """Sets label, scale, limits and ticks of the axis "x" or "y".

    Args:
        name_size: of the names of ticks, see `texts.shortened`.
        narrow: whether there is room for few numbers only.
    """
    axes.set(**{f"{name}scale": "log" if axis.log else "linear", f"{name}lim": axis.limits})
    drawn = axes.xaxis if name == "x" else axes.yaxis
    drawn.set_label_text(label, fontsize=SMALL, parse_math=False)
    if axis.names is not None:
        shown = [texts.shortened(one, *name_size) for one in axis.names]
        for tick in drawn.set_ticks(axis.ticks or (), shown):
            tick.label1.set_parse_math(False)
    elif axis.ticks is not None:
        drawn.set_ticks(axis.ticks[:: 2 if narrow and len(axis.ticks) > 4 else 1])
    elif axis.integer:
        drawn.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    elif axis.log and np.log10(axis.limits[1] / axis.limits[0]) < _DECADES:
        first, last = np.ceil(np.log10(axis.limits[0])), np.floor(np.log10(axis.limits[1]))
        few = narrow and last > first
        drawn.set_major_locator(LogLocator(subs=(1,) if few else (1, 2, 5)))
        drawn.set_minor_formatter(NullFormatter())
        drawn.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    elif not axis.log:
        drawn.set_major_locator(MaxNLocator(3 if narrow else 6, steps=[1, 2, 2.5, 5, 10]))
    if axis.unit != 1:
        drawn.set_major_formatter(FuncFormatter(lambda value, _: f"{value * axis.unit:g}"))
    if axis.opposite is not None:
        label, factor = axis.opposite
        scale = partial(np.multiply, factor), partial(np.multiply, 1 / factor)
        other = axes.secondary_xaxis("top", functions=scale)
        other.set_xlabel(label, fontsize=SMALL)
        other.tick_params(labelsize=SMALL)


def tick_size(panel: Panel, sheet: Sheet) -> float:
    """Returns the font size of a panel's numbers and names, in points."""
    if panel.heat_map is None or panel.heat_map.is_map:
        return SMALL
    return heat_map_layout.table_texts(panel, sheet)[0]


def norm_of(heat_map: HeatMap) -> Normalize:
    """Returns the scale of a heat map's colors."""
    return (LogNorm if heat_map.log else Normalize)(*heat_map.limits)


def look(style: Style) -> dict[str, Any]:
    """Returns a style as arguments for matplotlib's lines."""
    return {
        "color": style.color,
        "ls": style.dash,
        "lw": style.width,
        "alpha": style.alpha,
        "marker": style.marker,
        "ms": style.size,
        "markevery": style.every,
        "mfc": "white" if style.hollow else style.color,
    }
