"""Renders the page as a self-contained HTML file that loads nothing from the network."""

import base64
import hashlib
from collections.abc import Iterator, Sequence
from importlib import resources

import pandas as pd

from jbench.paper.citation import CITATION
from jbench.report.document import Document, FigureItem, Section, TableItem
from jbench.report.figures.layout import SCREEN, Sheet
from jbench.report.page import colors, downloads, tables, values, vector
from jbench.report.page.budget import share_each
from jbench.report.page.text import html, identifier, json_block, paragraphs

_PROVENANCE = "Command, versions and machine of each run."
_ABOUT = (
    "This file is self-contained: it loads nothing and sends nothing. Tooltips show at most {} "
    "evenly spaced points of each line; the data to download contain the others."
)
_SOURCE = "The published curves were read from the figures of: {}"
_PAPER = (515, 570)  # points; maximum width and height of a figure on paper in portrait format
_PAPER_TURNED = (770, 425)  # points; the same in landscape format
_PIXELS = 4 / 3  # pixels per point
_RELOAD = '<meta http-equiv="refresh" content="30">\n'


def render_document(document: Document, *, sheet: Sheet = SCREEN, reloads: bool = False) -> str:
    """Returns the page of a report as reproducible HTML.

    It contains style, script, figures and the data to download. Its Content-Security-Policy allows
    only its own style and script, so that nothing is loaded or sent, and text in the results can't
    become a script. It is readable without scripts.

    Args:
        document: content of the page.
        sheet: format of the figures.
        reloads: whether the page reloads itself twice a minute.
    """
    parts = _Parts(document, sheet)
    body = "\n".join(_body(document, parts))
    style = "\n".join([_asset("style.css"), *parts.styles, colors.rules(parts.colors)])
    script = _asset("script.js")
    policy = "; ".join(
        [
            "default-src 'none'",
            f"style-src '{_hash(style)}'",
            f"script-src '{_hash(script)}'",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="referrer" content="no-referrer">
<link rel="icon" href="data:,">
{_RELOAD if reloads else ""}<title>{html(document.title)}</title>
<style>{style}</style>
</head>
<body>
{body}
<script>{script}</script>
</body>
</html>
"""


def still(page: bytes) -> bytes:
    """Returns a page without its automatic reload."""
    return page.replace(_RELOAD.encode(), b"", 1)


class _Parts:
    """State that the parts of a page share: ids, size limits, and styles.

    Attributes:
        sheet: format of the figures.
        cells: maximum cells of a table to download.
        corners: maximum points of a figure that is not rasterized.
        points: maximum points of a line in tooltips.
        colors: colors of all figures.
        styles: CSS rules of single figures.
    """

    def __init__(self, document: Document, sheet: Sheet) -> None:
        self.sheet = sheet
        items = [item for section in document.sections for item in section.items]
        figures = [item for item in items if isinstance(item, FigureItem)]
        frames = [item.frame for item in items if isinstance(item, TableItem)]
        frames += [item.data for item in figures if item.data is not None]
        tables_of_data = [frame.size for frame in (*frames, document.provenance)]
        self.cells = share_each(tables_of_data, downloads.CELLS)
        self.corners = share_each([item.figure.corners for item in figures], vector.CORNERS)
        self.points = values.points_each(item.figure for item in figures)
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


def _body(document: Document, parts: _Parts) -> Iterator[str]:
    made = f'<p class="made">Made by <code>{html(document.command)}</code></p>'
    ids = [parts.id(f"to-{section.title}") for section in document.sections]
    links = [
        ("to-summary", "Summary"),
        *((id, section.title) for id, section in zip(ids, document.sections, strict=True)),
        *([("to-notes", "Notes")] if document.notes else []),
        ("to-provenance", "Provenance"),
    ]
    yield f"<header>\n<h1>{html(document.title)}</h1>\n{made}\n</header>"
    yield '<nav aria-label="Contents"><ul>'
    yield from (f'<li><a href="#{id}">{html(title)}</a></li>' for id, title in links)
    yield "</ul></nav>\n<main>"
    yield f'<section id="to-summary" class="summary">\n<h2>Summary</h2>\n{_list(document.summary)}'
    yield "</section>"
    if document.problems:
        yield '<section id="to-problems" class="problems">\n<h2>Problems</h2>'
        yield f"{_list(document.problems)}</section>"
    for id, section in zip(ids, document.sections, strict=True):
        yield from _section(id, section, made, parts)
    if document.notes:
        yield '<section id="to-notes" class="notes">\n<h2>Notes</h2>'
        yield f"{_list(document.notes)}</section>"
    yield from _provenance(document.provenance, made, parts)
    about, source = html(_ABOUT.format(parts.points)), html(_SOURCE.format(CITATION))
    yield f"</main>\n<footer><p>{about}</p><p>{source}</p></footer>"


def _section(id: str, section: Section, made: str, parts: _Parts) -> Iterator[str]:
    yield f'<section id="{id}">\n<h2>{html(section.title)}</h2>'
    yield paragraphs(section.text)
    for item in section.items:
        if isinstance(item, FigureItem):
            yield from _figure(item, made, parts)
        else:
            yield from _table(item, made, parts)
    yield "</section>"


def _figure(item: FigureItem, made: str, parts: _Parts) -> Iterator[str]:
    id = parts.id(item.name)
    drawing = vector.element(item.figure, f"{id}-", item.title, parts.sheet, parts.corners)
    parts.colors |= drawing.colors
    # On a phone, figures stay readable and scroll.
    parts.styles.append(
        f"#{id} svg{{width:{drawing.width * _PIXELS:.0f}px}}"
        f"@media screen and (max-width:48rem){{#{id} svg{{width:{drawing.width:.0f}px}}}}"
    )
    wide = " wide" if _is_wide(drawing) else ""
    panels = values.panels(item.figure, drawing.boxes, parts.points)
    yield f'<figure id="{id}" class="item{wide}">\n<h3>{html(item.title)}</h3>'
    yield f'<div class="scroll drawing">{drawing.svg}</div>'
    if panels:
        yield f'<script type="application/json" class="values">{json_block(panels)}</script>'
    yield f"<figcaption>\n<p>{html(item.figure.caption)}</p>"
    yield _foot(item.name, item.data, made, parts)
    yield "</figcaption>\n</figure>"


def _is_wide(drawing: vector.Drawing) -> bool:
    """Returns whether a figure is much larger when printed in landscape format."""
    upright, turned = (
        min(1, width / drawing.width, height / drawing.height)
        for width, height in (_PAPER, _PAPER_TURNED)
    )
    return turned > 1.35 * upright


def _table(item: TableItem, made: str, parts: _Parts) -> Iterator[str]:
    wide = " wide" if tables.is_wide(item.frame) else ""
    yield f'<div id="{parts.id(item.name)}" class="item{wide}">\n<h3>{html(item.title)}</h3>'
    yield tables.table(item.frame, item.title)
    yield f'<div class="caption">\n<p>{html(item.caption)}</p>'
    yield _foot(item.name, item.frame, made, parts)
    yield "</div>\n</div>"


def _provenance(frame: pd.DataFrame, made: str, parts: _Parts) -> Iterator[str]:
    wide = ' class="wide"' if tables.is_wide(frame) else ""
    yield f'<section id="to-provenance"{wide}>\n<h2>Provenance</h2>'
    if frame.empty:
        yield "<p>There are no runs.</p>\n</section>"
        return
    yield f"<p>{html(_PROVENANCE)}</p>"
    yield f'<div class="item">\n{tables.table(frame, "Provenance")}'
    yield f'<div class="caption">{_foot("provenance", frame, made, parts)}</div>\n</div>'
    yield "</section>"


def _foot(name: str, frame: pd.DataFrame | None, made: str, parts: _Parts) -> str:
    """Returns the footer of an item: its data, and the command that made it."""
    link = "" if frame is None else downloads.link(name, frame, parts.cells)
    data = f'<p class="data">{link}</p>' if link else ""
    return f'<div class="foot">{data}{made}</div>'


def _list(sentences: Sequence[str]) -> str:
    items = "\n".join(f"<li>{html(sentence)}</li>" for sentence in sentences)
    return f"<ul>\n{items}\n</ul>\n" if items else ""


def _asset(name: str) -> str:
    text = resources.files("jbench.report.page").joinpath(name).read_text("utf-8")
    return f"\n{text}"


def _hash(content: str) -> str:
    """Returns the hash of an element's content for a Content-Security-Policy."""
    digest = hashlib.sha256(content.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
