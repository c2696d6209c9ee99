"""Makes matplotlib's SVG fit for a page.

A page has many figures, a theme, and a policy that forbids style attributes. So ids differ between
figures, styles become presentation attributes, black becomes the color of the text, and the tip of
a mark, which matplotlib keeps as a link, becomes its title.
"""

import io
import re
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbench.report import style
from jbench.report.figures import marks
from jbench.report.figures.chart import Panel

_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
_COLORS = {style.INK: "currentColor", "#ffffff": "var(--card)"}
_COLORS |= {style.SOFT: "var(--soft)", style.LINE: "var(--line)"}
_FONT = re.compile(r"(?:(bold|\d+) )?([\d.]+)px")
_NUMBER = re.compile(r"-?\d+\.\d\d+")
_EDGE = 3  # points around a panel
_NO_DATES = {"Date": None, "Creator": None, "Format": None, "Type": None}


def panel_svgs(panel: Panel, label: str, name: str) -> str:
    """Returns the versions of a panel as SVG elements of a page, with their names as classes.

    The label says what it shows to readers who can't see it. The name is that of no other panel of
    the page: ids are made of it.
    """
    texts: list[str] = []
    with mpl.rc_context(style.PAGE):
        figure = Figure(figsize=panel.size, dpi=72)
        axes = figure.subplots()
        for names, draw in panel.versions.items():
            draw(axes)
            marks.leave_out_empty(axes)
            if not texts:  # all versions have the same place, so that a switch moves nothing
                _fill(figure, axes)
            mpl.rcParams["svg.hashsalt"] = f"{name} {names}"
            sink = io.BytesIO()
            figure.savefig(sink, format="svg", transparent=True, metadata=_NO_DATES)
            texts.append(_element(sink.getvalue(), label, names))
    return "".join(texts)


def _fill(figure: Figure, axes: Axes) -> None:
    """Stretches axes until they fill the figure with all that is written beside them.

    matplotlib's constrained layout would measure every text twice.
    """
    written = axes.get_tightbbox(for_layout_only=True)
    assert written is not None
    inner = axes.get_position(original=True).get_points()
    outer = written.transformed(figure.transFigure.inverted()).get_points()
    edge = _EDGE / np.array(figure.bbox.size)
    (left, bottom), (right, top) = inner - outer + [[0, 0], [1, 1]] + [edge, -edge]
    axes.set_position((left, bottom, right - left, top - bottom))


def _element(content: bytes, label: str, names: str) -> str:
    root = ElementTree.fromstring(content)
    _clean(root)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.attrib |= {"role": "img", "aria-label": label} | ({"class": names} if names else {})
    text = ElementTree.tostring(root, encoding="unicode")
    return text.replace("ns0:", "").replace(":ns0=", "=").replace("\n", "")


def _clean(parent: ElementTree.Element) -> None:
    """Drops metadata, and replaces styles, colors, links and ids of series, in all descendants."""
    for element in list(parent):
        if element.tag in (f"{_SVG}metadata", f"{_SVG}style"):
            parent.remove(element)
            continue
        _set_attributes(element)
        if parent.tag != f"{_SVG}defs":
            element.attrib.pop("id", None)  # only definitions are referred to
        if element.tag == f"{_SVG}a":
            # A link around marks becomes a group with a title.
            tip, element.tag = element.get("href"), f"{_SVG}g"
            element.attrib.clear()
            if tip:
                element.insert(0, title := ElementTree.Element(f"{_SVG}title"))
                title.text = tip
        element.text = element.text if element.tag in (f"{_SVG}text", f"{_SVG}title") else None
        element.tail = None
        _clean(element)
        if element.tag == f"{_SVG}defs" and not len(element):
            parent.remove(element)


def _set_attributes(element: ElementTree.Element) -> None:
    for declaration in element.attrib.pop("style", "").split(";"):
        name, _, value = (part.strip() for part in declaration.partition(":"))
        if name == "font":
            weight, height = _FONT.search(value).groups()  # type: ignore[union-attr]
            element.set("font-size", height)
            if weight in ("bold", "700"):
                element.set("font-weight", "700")
        elif name and not name.startswith("font-"):
            element.set(name, value)
        elif name in ("font-size", "font-weight"):
            element.set(name, value.removesuffix("px"))
    if _LINK in element.attrib:
        element.set("href", element.attrib.pop(_LINK))
    for name in ("fill", "stroke"):
        if (color := element.get(name)) in _COLORS:
            element.set(name, _COLORS[color])
    if element.get("stroke") == "none":
        element.attrib.pop("stroke")
    if element.get("fill") == "none" and element.get("stroke") is None:
        element.attrib.pop("clip-path", None)  # a place for the pointer, where nothing is drawn
    if element.get("transform", "").startswith("rotate(-0 "):
        element.attrib.pop("transform")
    for name in ("d", "x", "y"):
        if name in element.attrib:  # a tenth of a point is less than a pixel
            value = _NUMBER.sub(lambda number: f"{float(number[0]):.1f}", element.attrib[name])
            value = re.sub(r"\s*([MLCQz])\s*", r"\1", value.strip())
            element.set(name, re.sub(r"\.0(?!\d)", "", value).replace(" -", "-"))
    number = re.fullmatch(r"series-(\d+)", element.get("id", ""))
    if number:
        element.attrib.pop("id")
        element.set("data-series", number[1])
    elif element.tag == f"{_SVG}text" and element.get("fill") is None:
        element.set("fill", "currentColor")
