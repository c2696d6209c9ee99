"""Converts matplotlib's SVG for a page: unique ids, no inline styles, colors for dark pages.

The page's Content-Security-Policy forbids inline styles, in which matplotlib writes every color.
They become attributes of SVG here.
"""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple
from xml.etree import ElementTree

from matplotlib.figure import Figure as Drawn

from jbench.report.figure import Figure
from jbench.report.figures.layout import SCREEN, Sheet
from jbench.report.figures.panels import SERIES
from jbench.report.figures.plotting import KEPT, draw, to_svg
from jbench.report.page.text import html, plain
from jbench.report.page.values import Box

CORNERS = 250_000
"""Maximum points of the lines and areas of all figures in a page, each about 14 bytes."""

_COLOR = re.compile(r"#[0-9a-f]{6}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_DECIMALS = re.compile(r"(?<=\.\d)\d+")  # a tenth of a point is precise enough
# Characters that are invalid in XML: matplotlib writes every text into a comment unchanged.
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
# From the style sheet that matplotlib puts into each SVG; here, elements inherit it from the root.
_INHERITED = {"stroke-linejoin": "round", "stroke-linecap": "butt"}
_AROUND = 1.5  # points about a panel and its texts
_NOT_ATTRIBUTES = ("font", "mix-blend-mode", "-inkscape-stroke")


class Drawing(NamedTuple):
    """A figure as SVG.

    Attributes:
        svg: its elements, one after the other, with a `viewBox` in points (1/72 inch) each.
        colors: its colors, "#rrggbb", that differ on a dark page.
        widths: widths of the elements in points.
        height: height in points.
        boxes: boxes of its panels.
    """

    svg: str
    colors: set[str]
    widths: list[float]
    height: float
    boxes: list[Box]

    @property
    def width(self) -> float:
        """Width of all elements side by side, in points."""
        return sum(self.widths)


class _View(NamedTuple):
    """Part of a drawing that is an element of its own: left, top, width and height in points."""

    left: float
    top: float
    width: float
    height: float

    @property
    def box(self) -> str:
        """The `viewBox` of the element."""
        return " ".join(f"{number:.6g}" for number in self)


def element(
    figure: Figure, prefix: str, title: str, sheet: Sheet = SCREEN, max_points: int = CORNERS
) -> Drawing:
    """Returns a figure as reproducible SVG for a page, without title, legend and notes.

    Panels of lines are elements of their own, so that a narrow page can stack them.

    Args:
        figure: the figure.
        prefix: prefix of every id in the elements, unique in the page.
        title: text for screen readers.
        sheet: format of the figure.
        max_points: lines and areas of a figure with more points are rasterized.
    """
    drawn = draw(figure, sheet, text=False, legend=False, picture=figure.corners > max_points)
    root = ElementTree.fromstring(_NOT_XML.sub("", to_svg(drawn).decode()))
    width, height = (float(part) for part in root.attrib["viewBox"].split()[2:])
    # The axes of a second scale are inside those of their panel.
    groups = [one for group in root for one in group if one.get("id", "").startswith("axes_")]
    _number(groups[: len(figure.panels)])
    colors: set[str] = set()
    # The hatch pattern of a heat map is among the definitions.
    heat_map = any(panel.heat_map is not None for panel in figure.panels)
    _tag(root, figure)
    _clean(root, prefix, colors, (KEPT, "h") if heat_map else (KEPT,), False)
    _drop_ids(root)
    split = len(figure.panels) > 1 and all(
        panel.heat_map is None and panel.y.names is None for panel in figure.panels
    )
    if split:
        views = _views(drawn, height)
        svg = "".join(_parts(root, groups, views, title, figure))
    else:
        views = [_View(0, 0, width, height)]
        svg = _svg(ElementTree.tostring(root, encoding="unicode"), views[0], title)
    places = (axes.get_position() for axes in drawn.axes[: len(figure.panels)])
    boxes = [
        (at.x0 * width, (1 - at.y1) * height, at.x1 * width, (1 - at.y0) * height) for at in places
    ]
    return Drawing(svg, colors, [view.width for view in views], views[0].height, boxes)


def _views(drawn: Drawn, height: float) -> list[_View]:
    """Returns the part of each panel: as wide as its texts, and as high as those of all."""
    scale = 72 / drawn.dpi
    around: list[Any] = [axes.get_tightbbox() for axes in drawn.axes]
    pairs = list(zip(drawn.axes, around, strict=True))
    above = max(box.y1 - axes.bbox.y1 for axes, box in pairs) * scale + _AROUND
    below = max(axes.bbox.y0 - box.y0 for axes, box in pairs) * scale + _AROUND
    found = []
    for axes, box in pairs:
        place = axes.get_position()
        left, right = box.x0 * scale - _AROUND, box.x1 * scale + _AROUND
        top, bottom = (1 - place.y1) * height - above, (1 - place.y0) * height + below
        found.append(_View(left, top, right - left, bottom - top))
    return found


def _parts(
    root: ElementTree.Element,
    groups: list[ElementTree.Element],
    views: list[_View],
    title: str,
    figure: Figure,
) -> Iterator[str]:
    """Yields an element for the shared definitions, and one for each panel."""
    shared = [child for child in root if child.tag == "defs"]
    defs = "".join(ElementTree.tostring(one, encoding="unicode") for one in shared)
    yield f'<svg class="defs" width="0" height="0" aria-hidden="true">{defs}</svg>'
    for group, view, panel in zip(groups, views, figure.panels, strict=False):
        inner = ElementTree.Element("svg")
        inner.append(group)
        name = f"{title}: {panel.title}" if panel.title else title
        yield _svg(ElementTree.tostring(inner, encoding="unicode"), view, name)


def _svg(text: str, view: _View, title: str) -> str:
    """Returns an element with the content of another one, `text`."""
    body = text.partition(">")[2]
    inherited = " ".join(f'{name}="{value}"' for name, value in _INHERITED.items())
    return (
        f'<svg role="img" aria-label="{html(title)}" width="{view.width:g}pt" '
        f'height="{view.height:g}pt" viewBox="{view.box}" {inherited}>{body}'
    )


def _number(groups: list[ElementTree.Element]) -> None:
    """Marks panels, and the ticks of their axes, which a page changes when it zooms."""
    for number, group in enumerate(groups):
        group.set("data-panel", str(number))
        for one in group.iter():
            name, is_tick, _ = one.get("id", "").partition("tick_")
            if is_tick:
                one.set("data-tick", name)


def _tag(root: ElementTree.Element, figure: Figure) -> None:
    """Marks the elements of series: entries of the legend by number, and what pages filter by."""
    entries = {label: i for i, (label, _) in enumerate(figure.legend)}
    for one in root.iter():
        name, _, place = one.get("id", "").partition("-")
        if name == SERIES and place:
            panel, number, _ = (int(part) for part in place.split("-"))
            series = figure.panels[panel].series[number]
            of = [str(entries[entry]) for entry in series.entries if entry in entries]
            one.set("data-of", " ".join(of))
            for tag, value in series.tags.items():
                one.set(f"data-{tag}", plain(value))


def _clean(
    element: ElementTree.Element, prefix: str, colors: set[str], keep: tuple[str, ...], kept: bool
) -> None:
    """Converts an element and its children in place, and collects their colors.

    Args:
        element: element to convert.
        prefix: prefix of ids.
        colors: receives the colors that differ on a dark page.
        keep: prefixes of the ids of elements that keep their colors.
        kept: whether a parent keeps its colors.
    """
    element.tag = element.tag.rpartition("}")[2]
    element.text = element.tail = None
    for child in list(element):
        if child.tag.rpartition("}")[2] in ("metadata", "style", "title"):
            element.remove(child)
    begins = element.get("id", "").startswith(keep)
    kept = kept or begins
    for name, value in list(element.attrib.items()):
        del element.attrib[name]
        element.attrib.update(_attributes(name.rpartition("}")[2], value, prefix))
    for name in ("fill", "stroke"):
        color = element.get(name, "")
        if _COLOR.fullmatch(color) and kept:
            element.set(name, _unmatched(color))
        elif _COLOR.fullmatch(color):
            colors.add(color)
    if begins and element.get("fill") is None:
        element.set("fill", _unmatched("#000000"))  # the default, which the page's CSS changes
    for child in element:
        _clean(child, prefix, colors, keep, kept)


def _attributes(name: str, value: str, prefix: str) -> dict[str, str]:
    """Returns the attributes in a page for an attribute of matplotlib's SVG."""
    if name == "style":
        pairs = [part.split(":", 1) for part in value.split(";") if ":" in part]
        styles = {key.strip(): text.strip() for key, text in pairs}
        return {
            key: _REFERENCE.sub(rf"url(#{prefix}\1)", text)
            for key, text in styles.items()
            if key not in _NOT_ATTRIBUTES
        }
    if name == "id":
        return {name: prefix + value}
    if name == "href":
        return {name: f"#{prefix}{value[1:]}" if value.startswith("#") else value}
    if name == "d":
        return {name: _DECIMALS.sub("", " ".join(value.split()))}
    return {name: _REFERENCE.sub(rf"url(#{prefix}\1)", value)}


def _drop_ids(root: ElementTree.Element) -> None:
    """Removes the ids that nothing refers to, which are most."""
    used = {
        name
        for element in root.iter()
        for value in element.attrib.values()
        for name in (*_REFERENCE.findall(value), value[1:] if value.startswith("#") else "")
    }
    for element in root.iter():
        if element.get("id") not in used:
            element.attrib.pop("id", None)


def _unmatched(color: str) -> str:
    """Returns a color in a notation that the dark page's style sheet does not match."""
    return f"rgb({','.join(str(int(color[i : i + 2], 16)) for i in (1, 3, 5))})"
