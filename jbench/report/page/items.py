"""Figures and tables of a page."""

from collections.abc import Iterator, Sequence

import pandas as pd

from jbench.report.document import Document, FigureItem, Item, TableItem
from jbench.report.figures.layout import Sheet
from jbench.report.page import downloads, legends, tables, tooltips, vector
from jbench.report.page.text import classes, html, identifier, json_block

_PAPER = (515, 570)  # points; maximum width and height of a figure on paper in portrait format
_PAPER_TURNED = (770, 425)  # points; the same in landscape format
_BESIDE = 430  # points; maximum width of a figure with its caption beside it
_SHORT = 220  # characters of a caption that is always shown
_BESIDE_SHORT = 1200  # the same beside a figure


def share_each(sizes: Sequence[int], total: int) -> int:
    """Returns the maximum size of each item so that all together take at most `total`.

    Small items take what they need, and the large ones share the rest equally.
    """
    left = total
    ordered = sorted(sizes)
    for i, size in enumerate(ordered):
        share = left // (len(ordered) - i)
        if size > share:
            return max(1, share)
        left -= size
    return max([1, *sizes])


class PageState:
    """State that the parts of a page share: ids, size limits, and styles.

    Attributes:
        cells: maximum cells of a table to download.
        corners: maximum points of a figure that is not rasterized.
        points: maximum points of a line in tooltips.
        styles: CSS rules of single figures.
    """

    def __init__(self, document: Document, sheet: Sheet) -> None:
        self.sheet = sheet
        items = document.items
        figures = [item for item in items if isinstance(item, FigureItem)]
        frames = [item.frame for item in items if isinstance(item, TableItem)]
        frames += [item.data for item in figures if item.data is not None]
        tables_of_data = [frame.size for frame in (*frames, document.provenance)]
        self.cells = share_each(tables_of_data, downloads.CELLS)
        self.corners = share_each([item.figure.corners for item in figures], vector.CORNERS)
        self.points = tooltips.points_each(item.figure for item in figures)
        self.colors: set[str] = set()
        self.styles: list[str] = []
        self._ids = {"to-summary", "to-problems", "to-notes", "to-provenance"}

    def id(self, name: str) -> str:
        """Returns a unique id that resembles a name."""
        base = new = identifier(name)
        count = 1
        while new in self._ids:
            count += 1
            new = f"{base}-{count}"
        self._ids.add(new)
        return new


def item(one: Item, state: PageState, heading: str = "", *, leads: bool = False) -> Iterator[str]:
    """Yields a figure or a table as HTML.

    Args:
        heading: heading of its section, which is not repeated.
        leads: whether it is on the first screen, where captions are folded.
    """
    if isinstance(one, FigureItem):
        yield from _figure(one, state, heading, leads)
    else:
        yield from _table(one, state, heading)


def foot(name: str, frame: pd.DataFrame | None, state: PageState) -> str:
    """Returns the link to the data of an item; empty if it has none."""
    link = "" if frame is None else downloads.link(name, frame, state.cells)
    return f'<p class="data">{link}</p>' if link else ""


def caption(texts: Sequence[str], name: str, *, shown: int = _SHORT) -> str:
    """Returns paragraphs; those of more characters than `shown` are folded behind their name."""
    content = "".join(f"<p>{html(text)}</p>\n" for text in texts)
    length = sum(map(len, texts))
    if length <= shown:
        return content if length else ""
    return f'<details class="how"><summary>{html(name)}</summary>{content}</details>'


def _figure(one: FigureItem, state: PageState, heading: str, leads: bool) -> Iterator[str]:
    id = state.id(one.name)
    drawing = vector.element(one.figure, f"{id}-", one.title, state.sheet, state.corners)
    state.colors |= drawing.colors
    for i, width in enumerate(drawing.widths):
        # Panels share the width of the page, and are below each other on a narrow one.
        state.styles.append(
            f"#{id} svg[role]:nth-of-type({i + 1})"
            f"{{flex-grow:{width:.0f};min-width:min(100%,{0.9 * width:.0f}pt)}}"
        )
    scrolls = len(drawing.widths) == 1 and (drawing.width > _BESIDE or len(one.figure.panels) > 1)
    if scrolls:
        # Texts stay readable on a phone.
        rule = f"#{id} .drawing svg[role]{{min-width:{0.8 * drawing.width:.0f}pt}}"
        state.styles.append(f"@media screen and (max-width:48rem){{{rule}}}")
    panels = tooltips.panels(one.figure, drawing.boxes, state.points)
    beside = drawing.width <= _BESIDE and not leads
    names = classes(item=True, wide=_is_wide(drawing), beside=beside, scrolls=scrolls)
    yield f'<figure id="{id}"{names}>\n{_heading(one.title, heading)}'
    yield f'<div class="plot">{legends.legend(one.figure, state.colors)}'
    yield f'<div class="scroll drawing">{drawing.svg}</div></div>'
    if panels:
        yield f'<script type="application/json" class="values">{json_block(panels)}</script>'
    shown = _BESIDE_SHORT if beside else 0 if leads else _SHORT
    yield "<figcaption>"
    yield caption([one.figure.caption], "How to read this figure", shown=shown)
    yield foot(one.name, one.data, state)
    yield "</figcaption>\n</figure>"


def _is_wide(drawing: vector.Drawing) -> bool:
    """Returns whether a figure is much larger when printed in landscape format."""
    upright, turned = (
        min(1, width / drawing.width, height / drawing.height)
        for width, height in (_PAPER, _PAPER_TURNED)
    )
    return turned > 1.35 * upright


def _table(one: TableItem, state: PageState, heading: str) -> Iterator[str]:
    names = classes(item=True, wide=tables.is_wide(one.frame))
    yield f'<div id="{state.id(one.name)}"{names}>'
    if one.folded:
        yield f"<details><summary><h3>{html(one.title)}</h3></summary>"
    else:
        yield _heading(one.title, heading)
    yield tables.table(one.frame, one.title)
    yield f'<div class="caption">\n{caption([one.caption], "How to read this table")}'
    yield foot(one.name, one.frame, state)
    yield "</div>" + ("</details>" if one.folded else "")
    yield "</div>"


def _heading(title: str, section: str) -> str:
    """Returns the heading of an item, unless it is that of its section."""
    return "" if title == section else f"<h3>{html(title)}</h3>"
