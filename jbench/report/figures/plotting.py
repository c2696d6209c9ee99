"""Draws figures with matplotlib, and writes their files."""

import io
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure as Drawn
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jbench.report.figure import Figure, Panel, Shade, Style
from jbench.report.figures import heat_map_layout, layout, texts
from jbench.report.figures.layout import SCREEN, Box, Layout, Sheet
from jbench.report.figures.panels import draw_panel, look, norm_of, tick_size
from jbench.report.figures.texts import SMALL

KEPT = "heat-map"
"""Prefix of the ids of SVG elements that keep their colors on a dark page."""

_LARGE = 12.0  # points
_PNG_DPI = {False: 150, True: 300}  # on a screen, and on paper
_PICTURE_DPI = 200  # resolution of rasterized parts in SVG and PDF files
_COMPACT: dict[str, Any] = {
    "borderaxespad": 0,
    "borderpad": 0,
    "labelspacing": 0.35,
    "handletextpad": 0.6,
}
"""Spacing of a legend, in units of its font size."""


def draw(
    figure: Figure,
    sheet: Sheet = SCREEN,
    *,
    text: bool = True,
    picture: bool = False,
) -> Drawn:
    """Draws a figure; the first of its axes are the panels in order.

    Args:
        text: whether to draw title, legend and notes; a paper has title and notes in its caption.
        picture: whether to rasterize lines and areas in SVG and PDF files.
    """
    titled = text and not sheet.paper
    if any(panel.heat_map is not None for panel in figure.panels):
        drawn = _heat_maps(figure, sheet, text=titled, picture=picture)
    else:
        drawn = _lines(figure, sheet, text=titled, legend=text, picture=picture)
    flat = (a for a, p in zip(drawn.axes, figure.panels, strict=False) if p.heat_map is not None)
    kept = (item for a in flat for item in (a.patch, *a.patches, *a.collections, *a.texts))
    for i, item in enumerate(kept):
        item.set_gid(f"{KEPT}-{i}")
    return drawn


def draw_alone(panel: Panel, number: int, laid: Layout, sheet: Sheet, *, picture: bool) -> Drawn:
    """Draws one panel of lines at its place in a figure, and nothing else.

    Args:
        number: its index in the figure.
        laid: layout of the figure.
        picture: see `draw`.
    """
    drawn = _empty(laid)
    _add_panel(drawn, panel, number, laid, sheet, picture=picture)
    return drawn


def to_png(drawn: Drawn, *, paper: bool = False) -> bytes:
    """Returns the figure as PNG, without a timestamp or version."""
    return _saved(drawn, format="png", dpi=_PNG_DPI[paper], metadata={"Software": None})


def to_svg(drawn: Drawn, *, paper: bool = False) -> bytes:
    """Returns the figure as reproducible SVG."""
    with matplotlib.rc_context({"svg.hashsalt": "jbench", "svg.fonttype": "path"}):
        metadata = {"Date": None, "Creator": None}
        return _saved(drawn, format="svg", dpi=_PICTURE_DPI, metadata=metadata)


def to_pdf(drawn: Drawn, *, paper: bool = False) -> bytes:
    """Returns the figure as PDF with TrueType fonts, as publishers require, and no timestamp."""
    with matplotlib.rc_context({"pdf.fonttype": 42}):
        metadata = {"CreationDate": None, "Creator": None, "Producer": None}
        return _saved(drawn, format="pdf", dpi=_PICTURE_DPI, metadata=metadata)


FORMATS: dict[str, Callable[..., bytes]] = {"png": to_png, "svg": to_svg, "pdf": to_pdf}
"""Writers of figure files by suffix."""


def _saved(drawn: Drawn, **options: Any) -> bytes:
    sink = io.BytesIO()
    drawn.savefig(sink, **options)
    return sink.getvalue()


def _lines(figure: Figure, sheet: Sheet, *, text: bool, legend: bool, picture: bool) -> Drawn:
    """Draws a figure whose size depends on its texts."""
    laid = layout.lay_out(figure, sheet, text=text, legend=legend)
    drawn = _empty(laid)
    for i, panel in enumerate(figure.panels):
        _add_panel(drawn, panel, i, laid, sheet, picture=picture)
    for (label, box), (_, style) in zip(laid.legend, figure.legend, strict=False):
        _entry(drawn, label, style, _corner(laid, box))
    if text:
        room = (laid.width - 3 * layout.MARGIN) / max(texts.width_of(figure.title, "bold"), 1e-9)
        corner = _corner(laid, Box(layout.MARGIN, layout.MARGIN))
        _text(drawn, corner, figure.title, min(_LARGE, SMALL * room), "bold")
        _text(drawn, _corner(laid, laid.notes), "\n".join(laid.lines), SMALL, "normal")
    return drawn


def _empty(laid: Layout) -> Drawn:
    drawn = Drawn((laid.width, laid.height), facecolor="white")
    FigureCanvasAgg(drawn)
    return drawn


def _add_panel(
    drawn: Drawn, panel: Panel, number: int, laid: Layout, sheet: Sheet, *, picture: bool
) -> None:
    place = laid.panels[number]
    left, top = _corner(laid, place.box)
    size = place.box.width / laid.width, place.box.height / laid.height
    axes = drawn.add_axes((left, top - size[1], *size), label=f"{number} {panel.title}")
    draw_panel(axes, panel, number, sheet, place, shared=laid.shared, picture=picture)


def _corner(laid: Layout, box: Box) -> tuple[float, float]:
    """Returns the upper left corner of a box as a share of the figure."""
    return box.left / laid.width, 1 - box.top / laid.height


def _heat_maps(figure: Figure, sheet: Sheet, *, text: bool, picture: bool) -> Drawn:
    """Draws a figure that matplotlib lays out; its panels share a color bar."""
    columns, width, height = heat_map_layout.free_size(figure, sheet, text=text)
    drawn = Drawn((width, height), facecolor="white", layout="constrained")
    FigureCanvasAgg(drawn)
    rows = -(-len(figure.panels) // columns)
    all_axes = list(drawn.subplots(rows, columns, squeeze=False).flat)
    for unused in all_axes[len(figure.panels) :]:
        unused.set_axis_off()
    for i, (axes, panel) in enumerate(zip(all_axes, figure.panels, strict=False)):
        draw_panel(axes, panel, i, sheet, picture=picture)
    heat_map = figure.panels[0].heat_map
    if heat_map is not None:
        bar = drawn.colorbar(
            ScalarMappable(norm_of(heat_map), "viridis"),
            ax=all_axes,
            shrink=0.8 if heat_map.is_map else 0.9,
            location="bottom" if heat_map_layout.bar_is_below(heat_map, sheet) else "right",
        )
        bar.set_label(heat_map.label, fontsize=SMALL)
        bar.ax.tick_params(labelsize=tick_size(figure.panels[0], sheet))
    if text:
        drawn.suptitle(figure.title, fontsize=_LARGE, fontweight="bold", parse_math=False)
    return drawn


def _entry(drawn: Drawn, label: str, style: Style | Shade, corner: tuple[float, float]) -> None:
    """Draws an entry of the legend."""
    if isinstance(style, Shade):
        handle: Artist = Patch(color=style.color, alpha=style.alpha, lw=0)
    else:
        handle = Line2D([], [], **look(style))
    legend = drawn.legend(
        [handle],
        [label],
        loc="upper left",
        bbox_to_anchor=corner,
        fontsize=SMALL,
        frameon=False,
        handlelength=layout.HANDLE * 72 / SMALL,
        **_COMPACT,
    )
    for text in legend.get_texts():
        text.set_parse_math(False)


def _text(drawn: Drawn, corner: tuple[float, float], text: str, size: float, weight: str) -> None:
    drawn.text(
        *corner,
        text,
        va="top",
        parse_math=False,
        fontsize=size,
        fontweight=weight,
        linespacing=1.3,
    )
