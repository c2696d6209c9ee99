"""Converts matplotlib's SVG for a page: unique ids, no inline styles, colors for dark pages.

The page's Content-Security-Policy forbids inline styles, in which matplotlib writes every color.
They become attributes of SVG here.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

from matplotlib.figure import Figure as Drawn

from jbench.remembered import remembered
from jbench.report.figure import Figure, Panel
from jbench.report.figures import layout
from jbench.report.figures.layout import SCREEN, Box, Layout, Sheet
from jbench.report.figures.panels import SERIES
from jbench.report.figures.plotting import KEPT, draw, draw_alone, to_svg
from jbench.report.page import svg
from jbench.report.page.text import html, plain
from jbench.report.page.tooltips import Edges

CORNERS = 250_000
"""Maximum points of the lines and areas of all figures in a page, each about 14 bytes."""

# Characters that are invalid in XML: matplotlib writes every text into a comment unchanged.
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
# From the style sheet that matplotlib puts into each SVG; here, elements inherit it from the root.
_INHERITED = 'stroke-linejoin="round" stroke-linecap="butt"'
_AROUND = 1.5  # points about a panel and its texts


class Drawing(NamedTuple):
    """A figure as SVG.

    Attributes:
        svg: its elements, one after the other, with a `viewBox` in points (1/72 inch) each.
        colors: its colors, "#rrggbb", that differ on a dark page.
        widths: of the elements, in points.
        height: of each element, in points.
        boxes: edges of each panel.
    """

    svg: str
    colors: set[str]
    widths: list[float]
    height: float
    boxes: list[Edges]

    @property
    def width(self) -> float:
        """Width of all elements side by side, in points."""
        return sum(self.widths)


class _Part(NamedTuple):
    """A part of a figure: one panel of lines, or all heat maps.

    Attributes:
        size: width and height of the figure in points.
        around: edges of all that is drawn.
    """

    content: str
    colors: set[str]
    size: tuple[float, float]
    boxes: list[Edges]
    around: Edges


def element(
    figure: Figure, prefix: str, title: str, sheet: Sheet = SCREEN, max_points: int = CORNERS
) -> Drawing:
    """Returns a figure as reproducible SVG for a page, without title, legend and notes.

    Panels of lines are elements of their own, so that a narrow page can stack them.

    Args:
        prefix: of every id in the elements, unique in the page.
        title: text for screen readers.
        max_points: lines and areas of a figure with more points are rasterized.
    """
    picture = figure.corners > max_points
    if any(panel.heat_map is not None for panel in figure.panels):
        parts = [_heat_maps(figure, prefix, sheet, picture=picture)]
    else:
        laid = layout.lay_out(figure, sheet, text=False, legend=False)
        panels = zip(figure.panels, figure.entry_numbers, strict=True)
        parts = [
            _panel(panel, i, entries, laid, sheet, f"{prefix}{i}-", picture=picture)
            for i, (panel, entries) in enumerate(panels)
        ]
    boxes = [box for part in parts for box in part.boxes]
    colors = set().union(*(part.colors for part in parts))
    if len(parts) == 1 or any(panel.y.names is not None for panel in figure.panels):
        shown = [("".join(part.content for part in parts), Box(0, 0, *parts[0].size), title)]
    else:
        contents = [part.content for part in parts]
        names = [f"{title}: {one.title}" if one.title else title for one in figure.panels]
        shown = list(zip(contents, _rectangles(parts), names, strict=True))
    elements = "".join(_svg(*one) for one in shown)
    widths = [rectangle.width for _, rectangle, _ in shown]
    return Drawing(elements, colors, widths, shown[0][1].height, boxes)


def _rectangles(parts: Sequence[_Part]) -> list[Box]:
    """Returns the rectangle to show of each panel; all are as high as the highest texts need."""
    pairs = [(part.around, box) for part in parts for box in part.boxes]
    above = max(box.top - around.top for around, box in pairs) + _AROUND
    below = max(around.bottom - box.bottom for around, box in pairs) + _AROUND
    return [
        Box(
            around.left - _AROUND,
            box.top - above,
            around.right - around.left + 2 * _AROUND,
            above + box.bottom - box.top + below,
        )
        for around, box in pairs
    ]


@remembered
def _heat_maps(figure: Figure, prefix: str, sheet: Sheet, *, picture: bool) -> _Part:
    """Returns a figure of heat maps."""
    drawn = draw(figure, sheet, text=False, picture=picture)
    root, size = _parsed(drawn)
    # The axes of the color bar have no panel.
    marked = zip(_axes(root), figure.panels, figure.entry_numbers, strict=False)
    for number, (axes, panel, entries) in enumerate(marked):
        _mark(axes, number, panel, entries)
    colors: set[str] = set()
    # The hatch pattern of a heat map, whose id begins with "h", is among the definitions.
    svg.clean(root, prefix, colors, (KEPT, "h"))
    boxes = _boxes(drawn, size)[: len(figure.panels)]
    return _Part(_content(root), colors, size, boxes, Edges(0.0, 0.0, *size))


@remembered
def _panel(
    panel: Panel,
    number: int,
    entries: Sequence[Sequence[int]],
    laid: Layout,
    sheet: Sheet,
    prefix: str,
    *,
    picture: bool,
) -> _Part:
    """Returns a panel of lines; `entries` are `Figure.entry_numbers` of the panel."""
    drawn = draw_alone(panel, number, laid, sheet, picture=picture)
    root, size = _parsed(drawn)
    # The axes of a second scale are inside those of their panel.
    (axes,) = _axes(root)
    _mark(axes, number, panel, entries)
    inner = ElementTree.Element("svg")
    inner.extend([axes, *(one for one in root if one.tag.endswith("defs"))])
    colors: set[str] = set()
    svg.clean(inner, prefix, colors)
    tight: Any = drawn.axes[0].get_tightbbox()
    scale, height = 72 / drawn.dpi, size[1]
    around = Edges(
        left=tight.x0 * scale,
        top=height - tight.y1 * scale,
        right=tight.x1 * scale,
        bottom=height - tight.y0 * scale,
    )
    return _Part(_content(inner), colors, size, _boxes(drawn, size), around)


def _parsed(drawn: Drawn) -> tuple[ElementTree.Element, tuple[float, float]]:
    """Returns a drawing as SVG, and its width and height in points."""
    root = ElementTree.fromstring(_NOT_XML.sub("", to_svg(drawn).decode()))
    width, height = (float(part) for part in root.attrib["viewBox"].split()[2:])
    return root, (width, height)


def _boxes(drawn: Drawn, size: tuple[float, float]) -> list[Edges]:
    """Returns the boxes of all axes in points."""
    width, height = size
    places = (axes.get_position() for axes in drawn.axes)
    return [
        Edges(at.x0 * width, (1 - at.y1) * height, at.x1 * width, (1 - at.y0) * height)
        for at in places
    ]


def _content(root: ElementTree.Element) -> str:
    """Returns the content of an element `svg`."""
    text = ElementTree.tostring(root, encoding="unicode")
    return text.partition(">")[2].removesuffix("</svg>")


def _svg(content: str, shown: Box, title: str) -> str:
    """Returns an element that shows a box (in points) of this content."""
    view = " ".join(f"{number:.6g}" for number in shown)
    return (
        f'<svg role="img" aria-label="{html(title)}" width="{shown.width:g}pt" '
        f'height="{shown.height:g}pt" viewBox="{view}" {_INHERITED}>{content}</svg>'
    )


def _axes(root: ElementTree.Element) -> list[ElementTree.Element]:
    """Returns the elements of the axes in a drawing, the panels first."""
    return [one for group in root for one in group if one.get("id", "").startswith("axes_")]


def _mark(
    axes: ElementTree.Element, number: int, panel: Panel, entries: Sequence[Sequence[int]]
) -> None:
    """Marks a panel for the script: its ticks, which change in a zoom, and its series.

    Series have the numbers of their entries in the legend, and what the page filters by.
    """
    axes.set("data-panel", str(number))
    for one in axes.iter():
        tick, is_tick, _ = one.get("id", "").partition("tick_")
        if is_tick:
            one.set("data-tick", tick)
        name, _, place = one.get("id", "").partition("-")
        if name == SERIES and place:
            index = int(place.split("-")[1])
            one.set("data-of", " ".join(map(str, entries[index])))
            for tag, value in panel.series[index].tags.items():
                one.set(f"data-{tag}", plain(value))
