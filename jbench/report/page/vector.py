"""Converts matplotlib's SVG for a page: unique ids, no inline styles, colors for dark pages.

The page's Content-Security-Policy forbids inline styles, in which matplotlib writes every color.
They become attributes of SVG here.
"""

import re
from typing import NamedTuple
from xml.etree import ElementTree

from jbench.report.figure import Figure
from jbench.report.figures.layout import SCREEN, Sheet
from jbench.report.figures.plotting import KEPT, draw, to_svg
from jbench.report.page.text import html
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
_NOT_ATTRIBUTES = ("font", "mix-blend-mode", "-inkscape-stroke")


class Drawing(NamedTuple):
    """A figure as SVG.

    Attributes:
        svg: the element, with a `viewBox` in points (1/72 inch).
        colors: its colors, "#rrggbb", that differ on a dark page.
        width: width in points.
        height: height in points.
        boxes: boxes of its panels.
    """

    svg: str
    colors: set[str]
    width: float
    height: float
    boxes: list[Box]


def element(
    figure: Figure, prefix: str, title: str, sheet: Sheet = SCREEN, max_points: int = CORNERS
) -> Drawing:
    """Returns a figure as a reproducible SVG element for a page, without title and notes.

    Args:
        figure: the figure.
        prefix: prefix of every id in the element, unique in the page.
        title: text for screen readers.
        sheet: format of the figure.
        max_points: lines and areas of a figure with more points are rasterized.
    """
    drawn = draw(figure, sheet, text=False, picture=figure.corners > max_points)
    root = ElementTree.fromstring(_NOT_XML.sub("", to_svg(drawn).decode()))
    width, height = (float(part) for part in root.attrib["viewBox"].split()[2:])
    colors: set[str] = set()
    # The hatch pattern of a heat map is among the definitions.
    heat_map = any(panel.heat_map is not None for panel in figure.panels)
    _clean(root, prefix, colors, (KEPT, "h") if heat_map else (KEPT,), False)
    _drop_ids(root)
    root.attrib = {"viewBox": f"0 0 {width:g} {height:g}", **_INHERITED}
    body = ElementTree.tostring(root, encoding="unicode").removeprefix("<svg ")
    label = f'<svg role="img" aria-label="{html(title)}" width="{width:g}pt" height="{height:g}pt" '
    places = (axes.get_position() for axes in drawn.axes[: len(figure.panels)])
    boxes = [
        (at.x0 * width, (1 - at.y1) * height, at.x1 * width, (1 - at.y0) * height) for at in places
    ]
    return Drawing(label + body, colors, width, height, boxes)


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
