"""Makes matplotlib's SVG fit for a page.

A page has many figures, a theme, and a policy that forbids style attributes. So ids differ between
figures, styles become presentation attributes, black becomes the color of the text, and the tip of
a mark, which matplotlib keeps as a link, becomes its title.
"""

import io
import re
from collections.abc import Sequence
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
_COLORS = {
    style.INK: "currentColor",
    style.SOFT: "var(--soft)",
    style.LINE: "var(--line)",
    "#ffffff": "var(--card)",
}
# A page has its own font, and lines begin with their dashes.
_STYLE = re.compile(r"(?:^|; )(?!font-family|stroke-dashoffset: 0(?:;|$))([\w-]+): ([^;]+)")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_SHARED = ("clip-path", "fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linecap")
_WRITTEN = ("font-size", "text-anchor")  # these mean nothing to lines and marks
_EDGE = 3  # points around a panel
# What a line of the grid has; a page has a thousand, and says it once.
_GRID = {
    "fill": "none",
    "stroke": _COLORS[style.LINE],
    "stroke-width": "0.8",
    "stroke-linecap": "square",
}
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
            root = ElementTree.fromstring(sink.getvalue())
            _clean(root)
            root.attrib = {"viewBox": root.attrib["viewBox"], "role": "img", "aria-label": label}
            if names:
                root.attrib["class"] = names
            texts.append(ElementTree.tostring(root, encoding="unicode").replace(" />", "/>"))

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


def _shortened(numbers: str) -> str:
    """Rounds coordinates to tenths of a point, less than a pixel; those of lines become steps."""
    if "L" in numbers and not {"C", "Q"} & {*numbers}:
        lines = []
        for line in numbers.split("M")[1:]:
            corners = np.array(_NUMBER.findall(line), float).reshape(-1, 2).round(1)
            offsets = np.diff(corners, axis=0, prepend=[[0, 0]]).round(1) + 0.0  # no -0
            x, y, *others = (f"{step:g}" for step in offsets.ravel().tolist())
            steps = f"l{' '.join(others)}" if others else ""
            lines.append(f"M{x} {y}{steps}{'z' if 'z' in line else ''}")

        return re.sub(r"(?<!\d)0\.", ".", "".join(lines).replace(" -", "-"))

    rounded = _NUMBER.sub(lambda n: f"{float(n[0]):.1f}".removesuffix(".0"), numbers)
    return re.sub(r"\s*([MLCQz])\s*", r"\1", rounded.strip()).replace(" -", "-")


def _clean(element: ElementTree.Element) -> None:
    """Replaces styles, colors, links and ids of series, in descendants as well; drops metadata."""
    element.tag = element.tag.removeprefix(_SVG)  # HTML needs no namespace
    for name, value in _STYLE.findall(element.attrib.pop("style", "")):
        element.set(name, _COLORS.get(value, value.removesuffix("px")))

    _drop_what_is_default(element)
    for name in ("d", "x", "y"):
        if value := element.get(name):
            element.set(name, _shortened(value))

    series = element.get("id", "").removeprefix("series-")
    if series.isdecimal():
        element.set("data-series", series)

    _replace_link(element)
    element.text = element.text if element.tag in ("text", "title") else None
    element.tail = None
    _clean_children(element)
    if element.tag == "g":
        _share(element)


def _drop_what_is_default(element: ElementTree.Element) -> None:
    """Drops attributes that the page's style sheet has, or that draw nothing."""
    if element.get("fill") == "none" and element.get("stroke") in (None, _COLORS[style.LINE]):
        element.attrib.pop("clip-path", None)  # a place for the pointer, or a line of the grid
    if element.attrib.keys() - {"d"} == _GRID.keys() and _GRID.items() <= element.attrib.items():
        for name in _GRID:
            element.attrib.pop(name)
        element.set("class", "g")
    if element.get("transform", "").startswith("rotate(-0 "):
        element.attrib.pop("transform")
    if element.tag == "use" and element.get("fill") == element.get("stroke") == _COLORS[style.SOFT]:
        for name in ("fill", "stroke", "stroke-width"):  # a tick, whose definition has them as well
            element.attrib.pop(name, None)


def _replace_link(element: ElementTree.Element) -> None:
    """Makes a link around marks a group with a title; other links lose their namespace."""
    link = element.attrib.pop(_LINK, None)
    if element.tag == "a":
        title = ElementTree.Element("title")
        title.text = link
        element.insert(0, title)
        element.tag = "g"
        element.attrib = {}
    elif link:
        element.set("href", link)


def _clean_children(element: ElementTree.Element) -> None:
    """Cleans the children; drops metadata, empty definitions, and ids that nobody refers to."""
    for child in list(element):
        _clean(child)
        if child.tag in ("metadata", "style") or (child.tag == "defs" and not len(child)):
            element.remove(child)
        elif element.tag != "defs":
            child.attrib.pop("id", None)  # only definitions are referred to


def _share(group: ElementTree.Element) -> None:
    """Moves up what all parts of a group have in common, and parts that are alone in a group."""
    parts = [part for part in group if part.tag not in ("title", "defs")]
    if any(part.get("transform") for part in parts):
        return  # it would move what clips a part

    texts = [part for part in parts if next(part.iter("text"), None) is not None]
    for name in _SHARED:
        _move_up(name, parts, group)
    for name in _WRITTEN:
        _move_up(name, texts, group)

    for i, part in enumerate(group):
        inner = part[0] if part.tag == "g" and len(part) == 1 else part
        # Marks keep their groups; a transform, or the place of a copy, would move what clips it.
        if not part.attrib or not (inner.tag in ("g", "use") or inner.get("transform")):
            inner.attrib = part.attrib | inner.attrib
            group[i] = inner


def _move_up(name: str, parts: Sequence[ElementTree.Element], group: ElementTree.Element) -> None:
    """Moves an attribute from parts of a group to the group, if all have the same value."""
    values = {part.get(name) for part in parts}
    if len(values) == 1 and None not in values and not group.get(name):
        group.set(name, str(values.pop()))
        for part in parts:
            part.attrib.pop(name)
