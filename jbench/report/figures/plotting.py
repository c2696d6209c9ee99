"""Draws figures with matplotlib, and writes their files."""

import io
from collections.abc import Callable, Sequence
from functools import partial
from textwrap import wrap
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure as Drawn
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter, MaxNLocator

from jbench.report.figure import DOTS, Axis, Figure, HeatMap, Panel, Series, Shade, Style
from jbench.report.figures import layout
from jbench.report.figures.layout import SCREEN, SMALL, Box, Sheet

KEPT = "heat-map"
"""Prefix of the ids of SVG elements that keep their colors on a dark page."""

_MEDIUM, _LARGE = 9.0, 12.0  # points
_PNG_DPI = 150
_PICTURE_DPI = 200  # resolution of rasterized parts in SVG and PDF files
_PICTURE_CELLS = 1000  # larger heat maps are rasterized: each cell would be a path of 200 bytes
_INTERVAL_ALPHA = 0.18
_COMPACT = {"borderaxespad": 0, "borderpad": 0, "labelspacing": 0.35, "handlelength": 3.2}
"""Spacing of a legend, in units of its font size."""

_ARROW = {"arrowstyle": "->", "color": "#d00000", "linewidth": 1.6}


def draw(
    figure: Figure, sheet: Sheet = SCREEN, *, text: bool = True, picture: bool = False
) -> Drawn:
    """Draws a figure; the first of its axes are the panels in order.

    Args:
        figure: the figure.
        sheet: its format.
        text: whether to draw title and notes; ignored for a paper, which has them in its caption.
        picture: whether to rasterize lines and areas in SVG and PDF files.
    """
    text = text and not sheet.paper
    make = _with_key if figure.key else _without_key
    drawn = make(figure, sheet, text=text, picture=picture)
    flat = (a for a, p in zip(drawn.axes, figure.panels, strict=False) if p.heat_map is not None)
    kept = (item for a in flat for item in (a.patch, *a.patches, *a.collections, *a.texts))
    for i, item in enumerate(kept):
        item.set_gid(f"{KEPT}-{i}")
    return drawn


def to_png(drawn: Drawn) -> bytes:
    """Returns the figure as PNG, without a timestamp or version."""
    return _saved(drawn, format="png", dpi=_PNG_DPI, metadata={"Software": None})


def to_svg(drawn: Drawn) -> bytes:
    """Returns the figure as reproducible SVG."""
    with matplotlib.rc_context({"svg.hashsalt": "jbench", "svg.fonttype": "path"}):
        metadata = {"Date": None, "Creator": None}
        return _saved(drawn, format="svg", dpi=_PICTURE_DPI, metadata=metadata)


def to_pdf(drawn: Drawn) -> bytes:
    """Returns the figure as PDF with TrueType fonts, as publishers require, and no timestamp."""
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        metadata = {"CreationDate": None, "Creator": None, "Producer": None}
        return _saved(drawn, format="pdf", dpi=_PICTURE_DPI, metadata=metadata)


FORMATS: dict[str, Callable[[Drawn], bytes]] = {"png": to_png, "svg": to_svg, "pdf": to_pdf}
"""Writers of figure files by suffix."""


def _saved(drawn: Drawn, **options: Any) -> bytes:
    sink = io.BytesIO()
    drawn.savefig(sink, **options)
    return sink.getvalue()


def _with_key(figure: Figure, sheet: Sheet, *, text: bool, picture: bool) -> Drawn:
    """Draws a figure whose size depends on its legends."""
    laid = layout.lay_out(figure, sheet, text=text)
    width, height = laid.width, laid.height
    drawn = Drawn((width, height), facecolor="white")
    FigureCanvasAgg(drawn)

    def corner(box: Box) -> tuple[float, float]:
        return box.left / width, 1 - box.top / height

    def legend(handles: Sequence[Artist], labels: Sequence[str], box: Box) -> None:
        place = {"loc": "upper left", "bbox_to_anchor": corner(box)}
        lines = [layout.in_lines(label, laid.characters) for label in labels]
        _legend(drawn, handles, lines, **place, **_COMPACT)

    for panel, box, below in zip(figure.panels, laid.panels, laid.legends, strict=True):
        left, top = corner(box)
        size = box.width / width, box.height / height
        axes = drawn.add_axes((left, top - size[1], *size), label=panel.title)
        handles = _draw_panel(axes, panel, sheet, picture=picture)
        legend(handles, panel.labels, below)
    labels, looks = zip(*figure.key, strict=True)
    legend([_handle(look) for look in looks], labels, laid.key)
    if text:
        _text(drawn, corner(Box(layout.MARGIN, layout.MARGIN)), figure.title, _LARGE, "bold")
        _text(drawn, corner(laid.notes), "\n".join(laid.lines), SMALL, "normal")
    return drawn


def _without_key(figure: Figure, sheet: Sheet, *, text: bool, picture: bool) -> Drawn:
    """Draws a figure that matplotlib lays out; its panels share a color bar."""
    columns, *size = layout.free_size(figure, sheet, text=text)
    drawn = Drawn((size[0], size[1]), facecolor="white", layout="constrained")
    FigureCanvasAgg(drawn)
    rows = -(-len(figure.panels) // columns)
    all_axes = list(drawn.subplots(rows, columns, squeeze=False).flat)
    for unused in all_axes[len(figure.panels) :]:
        unused.set_axis_off()
    characters = layout.free_characters(sheet, columns)
    for axes, panel in zip(all_axes, figure.panels, strict=False):
        handles = _draw_panel(axes, panel, sheet, picture=picture)
        labels = [layout.in_lines(label, characters) for label in panel.labels]
        _legend(drawn, handles, labels, loc="outside lower center")
    heat_map = figure.panels[0].heat_map
    if heat_map is not None:
        norm = (LogNorm if heat_map.log else Normalize)(*heat_map.limits)
        bottom = heat_map.is_map and sheet.paper
        bar = drawn.colorbar(
            ScalarMappable(norm, "viridis"),
            ax=all_axes,
            shrink=0.8 if heat_map.is_map else 0.9,
            location="bottom" if bottom else "right",
        )
        bar.set_label(heat_map.label, fontsize=SMALL)
        bar.ax.tick_params(labelsize=_tick_size(figure.panels[0], sheet))
    if text:
        drawn.suptitle(figure.title, fontsize=_LARGE, fontweight="bold", parse_math=False)
    return drawn


def _draw_panel(axes: Axes, panel: Panel, sheet: Sheet, *, picture: bool) -> list[Artist]:
    """Draws a panel; returns the artists for its legend."""
    _style_panel(axes, panel, sheet)
    if panel.heat_map is not None:
        _draw_heat_map(axes, panel.heat_map, sheet)
    labelled: list[Artist] = []
    for reference in panel.references:
        vertical, style = reference.vertical, reference.style
        line = (axes.axvline if vertical else axes.axhline)(reference.at, **_look(style))
        if reference.interval is not None:
            span = axes.axvspan if vertical else axes.axhspan
            span(*reference.interval, color=style.color, alpha=_INTERVAL_ALPHA, lw=0)
        labelled += [line] if reference.label else []
    for series in panel.series:
        drawn = _draw_series(axes, series, picture=picture)
        labelled += [drawn] if series.label else []
    if panel.arrow is not None:
        start, end = panel.arrow
        axes.annotate("", end, start, arrowprops=_ARROW)
    if panel.text:
        axes.text(0.5, 0.5, panel.text, transform=axes.transAxes, ha="center", color="0.4")
    return labelled


def _draw_series(axes: Axes, series: Series, *, picture: bool) -> Artist:
    style, x = series.style, series.x
    for band in series.bands:
        if band.bars:
            axes.vlines(x, band.low, band.high, colors=style.color, lw=style.width)
        else:
            look: dict[str, Any] = {"color": style.color, "alpha": band.alpha, "lw": 0}
            axes.fill_between(x, band.low, band.high, rasterized=picture, **look)
    more: dict[str, Any] = {"zorder": series.zorder, "rasterized": picture}
    if series.edges is not None:
        return axes.stairs(series.y, series.edges, color=style.color, lw=style.width, **more)
    partial_ = np.zeros(len(x), bool) if series.partial is None else series.partial
    (line,) = axes.plot(x, np.where(partial_, np.nan, series.y), **_look(style), **more)
    if partial_.any():
        # Dotted parts include the neighbouring solid points, so that there are no gaps.
        dotted = partial_ | np.r_[partial_[1:], False] | np.r_[False, partial_[:-1]]
        y = np.where(dotted, series.y, np.nan)
        axes.plot(x, y, color=style.color, ls=DOTS, lw=style.width, **more)
    return line


def _draw_heat_map(axes: Axes, heat_map: HeatMap, sheet: Sheet) -> None:
    low, high = heat_map.limits
    axes.pcolormesh(
        *(heat_map.x, heat_map.y, np.ma.masked_invalid(heat_map.values)),
        norm=(LogNorm if heat_map.log else Normalize)(low, high),
        cmap="viridis",
        rasterized=heat_map.values.size > _PICTURE_CELLS,
    )
    if heat_map.is_map:
        axes.set_aspect("equal")
        return
    axes.set_facecolor("0.93")
    axes.patch.set(hatch="////", edgecolor="0.75")
    size = layout.cell_text_size(heat_map, sheet)
    for cell in heat_map.texts:
        left, right = heat_map.x[cell.column : cell.column + 2]
        top, bottom = heat_map.y[cell.row : cell.row + 2]
        if cell.framed:
            sides = (left, top), right - left, bottom - top
            axes.add_patch(Rectangle(*sides, facecolor="white", edgecolor="0.6", linewidth=0.6))
        middle = (left + right) / 2, (top + bottom) / 2
        axes.text(*middle, cell.text, ha="center", va="center", color=cell.color, fontsize=size)


def _style_panel(axes: Axes, panel: Panel, sheet: Sheet) -> None:
    """Sets title, axes and grid of a panel."""
    flat = panel.heat_map is not None
    if panel.title:
        title = (
            layout.in_lines(panel.title, layout.free_characters(sheet, 2)) if flat else panel.title
        )
        look = (SMALL, "normal") if flat else (_MEDIUM, "bold")
        axes.set_title(title, loc="left", parse_math=False, fontsize=look[0], fontweight=look[1])
    axes.tick_params(labelsize=_tick_size(panel, sheet))
    _style_axis(axes, "x", panel.x)
    _style_axis(axes, "y", panel.y)
    if panel.heat_map is None:
        axes.grid(color="0.92", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    elif not panel.heat_map.is_map:
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        for label in axes.get_xticklabels() if len(panel.x.names or ()) > 1 else ():
            label.set(rotation=25, ha="right")


def _style_axis(axes: Axes, name: str, axis: Axis) -> None:
    """Sets label, scale, limits and ticks of the axis "x" or "y"."""
    axes.set(**{f"{name}scale": "log" if axis.log else "linear", f"{name}lim": axis.limits})
    drawn = axes.xaxis if name == "x" else axes.yaxis
    drawn.set_label_text(axis.label, fontsize=SMALL)
    if axis.names is not None:
        width = 20 if name == "x" else 30
        names = ["\n".join(wrap(n, width, max_lines=3, placeholder=" …")) for n in axis.names]
        for tick in drawn.set_ticks(axis.ticks or (), names):
            tick.label1.set_parse_math(False)
    elif axis.ticks is not None:
        drawn.set_ticks(axis.ticks)
    elif axis.integer:
        drawn.set_major_locator(MaxNLocator(integer=True))
    elif not axis.log:
        drawn.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    if axis.unit != 1:
        drawn.set_major_formatter(FuncFormatter(lambda value, _: f"{value * axis.unit:g}"))
    if axis.opposite is not None:
        label, factor = axis.opposite
        scale = partial(np.multiply, factor), partial(np.multiply, 1 / factor)
        other = axes.secondary_xaxis("top", functions=scale)
        other.set_xlabel(label, fontsize=SMALL)
        other.tick_params(labelsize=SMALL)


def _tick_size(panel: Panel, sheet: Sheet) -> float:
    if panel.heat_map is None or panel.heat_map.is_map:
        return SMALL
    return layout.cell_text_size(panel.heat_map, sheet)


def _look(style: Style) -> dict[str, Any]:
    """Returns a style as arguments for matplotlib's lines."""
    return {
        **{"color": style.color, "ls": style.dash, "lw": style.width, "alpha": style.alpha},
        **{"marker": style.marker, "ms": style.size, "markevery": style.every},
        "mfc": "white" if style.hollow else style.color,
    }


def _handle(look: Style | Shade) -> Artist:
    if isinstance(look, Shade):
        return Patch(color=look.color, alpha=look.alpha, lw=0)
    return Line2D([], [], **_look(look))


def _legend(drawn: Drawn, handles: Sequence[Artist], labels: Sequence[str], **place: Any) -> None:
    if not handles:
        return
    legend = drawn.legend(handles, labels, fontsize=SMALL, frameon=False, **place)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _text(drawn: Drawn, corner: tuple[float, float], text: str, size: float, weight: str) -> None:
    look: dict[str, Any] = {"fontsize": size, "fontweight": weight, "linespacing": 1.3}
    drawn.text(*corner, text, va="top", parse_math=False, **look)
