"""Figures as SVG inside a page: no ids that clash, no styles of their own, colours for dark pages.

A page whose Content-Security-Policy allows no inline style would show matplotlib's SVG in black, as
it says every colour in a `style` attribute. Here these become attributes of SVG itself.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple
from xml.etree import ElementTree

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.figure import Figure

from jbench.report.page.text import html

KEPT = "kept"
"""How ids of artists begin whose colours are the same on a dark page."""

_RASTER_CELLS = 1000  # a mesh of more cells is a picture: each would be a path of 200 bytes
_RASTER_DPI = 200

CORNERS = 250_000
"""Corners of the lines and areas of all figures of a page together, each about 14 bytes."""

_COLOR = re.compile(r"#[0-9a-f]{6}")
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_DECIMALS = re.compile(r"(?<=\.\d)\d+")  # a tenth of a point is less than the eye sees
# What XML can't hold: matplotlib writes every text into a comment as it is.
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
# Of the style sheet that matplotlib puts into each SVG; every element inherits it here.
_INHERITED = {"stroke-linejoin": "round", "stroke-linecap": "butt"}
_NOT_ATTRIBUTES = ("font", "mix-blend-mode", "-inkscape-stroke")


class Drawing(NamedTuple):
    """A figure as SVG.

    Attributes:
        svg: the element, with a `viewBox` in points (1/72 inch).
        colors: all of its colours, "#rrggbb", that a dark page has to change.
        width: in points.
        height: in points.
    """

    svg: str
    colors: set[str]
    width: float
    height: float


def corners(figure: Figure) -> int:
    """Returns how many corners the lines and areas of a figure have."""
    lines = [np.size(line.get_xdata(orig=False)) for axes in figure.axes for line in axes.lines]
    areas = [np.size(path.vertices) // 2 for area in _areas(figure) for path in area.get_paths()]
    return sum(lines) + sum(areas)


def draw(figure: Figure, prefix: str, title: str, most: int = CORNERS) -> Drawing:
    """Returns a figure as an element for a page: the same bytes for the same figure.

    Args:
        figure: to draw; it is left as it was.
        prefix: of every id in the element, unique in the page.
        title: what a screen reader says instead of the picture.
        most: corners; the lines and areas of a figure with more become a picture.
    """
    sink = io.BytesIO()
    with (
        _prepared(figure, most),
        matplotlib.rc_context({"svg.hashsalt": "jbench", "svg.fonttype": "path"}),
    ):
        figure.savefig(
            sink, format="svg", dpi=_RASTER_DPI, metadata={"Date": None, "Creator": None}
        )
    root = ElementTree.fromstring(_NOT_XML.sub("", sink.getvalue().decode()))
    width, height = (float(part) for part in root.attrib["viewBox"].split()[2:])
    colors: set[str] = set()
    # What hatches a heat map is not in it, but among the definitions.
    heat_map = any(element.get("id", "").startswith(KEPT) for element in root.iter())
    _clean(root, prefix, colors, (KEPT, "h") if heat_map else (KEPT,), False)
    _drop_ids(root)
    root.attrib = {"viewBox": f"0 0 {width:g} {height:g}", **_INHERITED}
    body = ElementTree.tostring(root, encoding="unicode").removeprefix("<svg ")
    label = f'<svg role="img" aria-label="{html(title)}" width="{width:g}pt" height="{height:g}pt" '
    return Drawing(label + body, colors, width, height)


@contextmanager
def _prepared(figure: Figure, most: int) -> Iterator[None]:
    """Marks what keeps its colours, and makes pictures of what is large, while it is drawn."""
    kept = [artist for axes in figure.axes for artist in _kept(axes)]
    many: list[Artist] = []
    if corners(figure) > most:
        many = [*_areas(figure), *(line for axes in figure.axes for line in axes.lines)]
    before = [(artist, artist.get_gid(), artist.get_rasterized()) for artist in (*kept, *many)]
    for artist in many:
        artist.set_rasterized(True)
    for i, artist in enumerate(kept):
        artist.set_gid(f"{KEPT}{i}")
        values = artist.get_array() if isinstance(artist, QuadMesh) else None
        if values is not None and values.size > _RASTER_CELLS:
            artist.set_rasterized(True)
    try:
        yield
    finally:
        for artist, gid, rasterized in before:
            artist.set_gid(gid)
            artist.set_rasterized(rasterized)


def _areas(figure: Figure) -> list[PolyCollection]:
    return [a for axes in figure.axes for a in axes.collections if isinstance(a, PolyCollection)]


def _kept(axes: Axes) -> list[Artist]:
    """Returns what lies inside a heat map: its numbers must be read on its colours."""
    meshes = [artist for artist in axes.collections if isinstance(artist, QuadMesh)]
    return [*meshes, *axes.images, *axes.texts, axes.patch] if meshes or axes.images else []


def _clean(
    element: ElementTree.Element, prefix: str, colors: set[str], keep: tuple[str, ...], kept: bool
) -> None:
    """Makes an element of a page of matplotlib's SVG, and notes the colours in it.

    Args:
        element: to change, with all in it.
        prefix: of ids.
        colors: gets the colours that a dark page has to change.
        keep: how ids of elements begin whose colours are kept.
        kept: whether an element around this one keeps its colours.
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
        element.set("fill", _unmatched("#000000"))  # what no fill means, where a page sets another
    for child in element:
        _clean(child, prefix, colors, keep, kept)


def _attributes(name: str, value: str, prefix: str) -> dict[str, str]:
    """Returns what an attribute of matplotlib's SVG is in a page."""
    if name == "style":
        pairs = [part.split(":", 1) for part in value.split(";") if ":" in part]
        said = {key.strip(): text.strip() for key, text in pairs}
        return {
            key: _REFERENCE.sub(rf"url(#{prefix}\1)", text)
            for key, text in said.items()
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
    """Takes away the ids that nothing refers to, which are most."""
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
    """Returns a colour in words that the dark page's style sheet does not look for."""
    return f"rgb({','.join(str(int(color[i : i + 2], 16)) for i in (1, 3, 5))})"
