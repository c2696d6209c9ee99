"""Renders the page as a self-contained HTML file that loads nothing from the network."""

import base64
import hashlib
from collections.abc import Callable, Iterator, Sequence
from importlib import resources

from jbench.paper.citation import CITATION
from jbench.report.document import Document, Section
from jbench.report.figures.layout import SCREEN, Sheet
from jbench.report.page import colors, items, runs, tables
from jbench.report.page.items import PageState
from jbench.report.page.text import classes, html, json_block, with_asides

_PROVENANCE = "Command, versions and machine of each run."
_ABOUT = (
    "This file is self-contained: it loads nothing and sends nothing. Drag across a figure to zoom "
    "in, and double click to zoom out. Tooltips show at most {} evenly spaced points of each line; "
    "the data to download contain the others."
)
_SOURCE = "The published curves were read from the figures of: {}"
_SHORT = 300  # characters of the text of a section that is always shown
_SCRIPTS = (
    "elements",
    "sorting",
    "axes",
    "state",
    "tooltips",
    "hiding",
    "saving",
    "zoom",
    "paths",
    "runs",
    "start",
)
"""Parts of the script in order: `start` calls the others."""
_RELOAD = '<meta http-equiv="refresh" content="30">\n'


def render_document(document: Document, *, sheet: Sheet = SCREEN, reloads: bool = False) -> str:
    """Returns the page of a report as reproducible HTML.

    It contains style, script, figures and the data to download. Its Content-Security-Policy allows
    only its own style and script, so that nothing is loaded or sent, and text in the results can't
    become a script. It is readable without scripts.

    Args:
        reloads: whether the page reloads itself twice a minute.
    """
    state = PageState(document, sheet)
    body = "\n".join(_body(document, state))
    style = "\n".join([_asset("style.css"), *state.styles, colors.rules(state.colors)])
    script = "".join(_asset(f"script/{name}.js") for name in _SCRIPTS)
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


def _body(document: Document, state: PageState) -> Iterator[str]:
    ids = [state.id(f"to-{section.title}") for section in document.sections]
    links = [
        ("to-summary", "Summary"),
        *([("to-problems", "Problems")] if document.problems else []),
        *((id, section.title) for id, section in zip(ids, document.sections, strict=True)),
        *([("to-notes", "Notes")] if document.notes else []),
        ("to-provenance", "Runs"),
    ]
    yield f"<header>\n<h1>{html(document.title)}</h1>"
    yield f'<p class="made">Made by <code>{html(document.command)}</code></p>\n</header>'
    yield '<nav aria-label="Contents"><ul>'
    yield from (f'<li><a href="#{id}">{html(title)}</a></li>' for id, title in links)
    yield "</ul></nav>\n<main>"
    yield from _overview(document, state)
    if document.problems:
        yield '<section id="to-problems" class="problems">\n<h2>Problems</h2>'
        yield f"{_list(document.problems)}</section>"
    for id, section in zip(ids, document.sections, strict=True):
        yield from _section(id, section, state)
    if document.notes:
        yield '<section id="to-notes" class="notes">\n<h2>Notes</h2>'
        yield f"{_list(document.notes)}</section>"
    yield from _provenance(document, state)
    about, source = html(_ABOUT.format(state.points)), html(_SOURCE.format(CITATION))
    yield f"</main>\n<footer><p>{about}</p><p>{source}</p></footer>"


def _overview(document: Document, state: PageState) -> Iterator[str]:
    """Yields the first screen: headline, figures, and numbers on what was run."""
    yield '<section id="to-summary" class="summary">\n<h2 class="unseen">Summary</h2>'
    if document.headline:
        yield f'<p class="headline">{with_asides(document.headline)}</p>'
    if document.overview:
        stacked = any(len(one.figure.panels) > 1 for one in document.overview)
        yield f"<div{classes(overview=True, stacked=stacked)}>"
        for one in document.overview:
            yield from items.item(one, state, leads=True)
        yield "</div>"
    if document.inventory:
        yield '<dl class="inventory">'
        for number, name in document.inventory:
            yield f"<div><dt>{html(name)}</dt><dd>{html(number)}</dd></div>"
        yield "</dl>"
    if document.summary:
        open_ = "" if document.headline else " open"
        yield f'<details class="more"{open_}><summary>The summary in detail</summary>'
        yield f"{_list(document.summary)}</details>"
    yield "</section>"


def _section(id: str, section: Section, state: PageState) -> Iterator[str]:
    yield f'<section id="{id}">\n<h2>{html(section.title)}</h2>'
    yield _list(section.answers, with_asides)
    yield items.caption(section.text, "What this section shows", shown=_SHORT)
    for one in section.items:
        yield from items.item(one, state, section.title)
    yield "</section>"


def _provenance(document: Document, state: PageState) -> Iterator[str]:
    frame = document.provenance
    yield f'<section id="to-provenance"{classes(wide=tables.is_wide(frame))}>\n<h2>Runs</h2>'
    if frame.empty:
        yield "<p>There are no runs.</p>\n</section>"
        return
    yield f"<p>{html(_PROVENANCE)}</p>"
    tags = [run.tags for run in document.runs] or None
    yield f'<div class="item">\n{tables.table(frame, "Runs", tags)}'
    if document.runs:
        content = json_block(runs.packed(document.runs))
        yield f'<script type="application/json" class="runs">{content}</script>'
    yield f'<div class="caption">{items.foot("provenance", frame, state)}</div>\n</div>'
    yield "</section>"


def _list(sentences: Sequence[str], form: Callable[[str], str] = html) -> str:
    lines = "\n".join(f"<li>{form(sentence)}</li>" for sentence in sentences)
    return f"<ul>\n{lines}\n</ul>\n" if lines else ""


def _asset(name: str) -> str:
    text = resources.files("jbench.report.page").joinpath(name).read_text("utf-8")
    return f"\n{text}"


def _hash(content: str) -> str:
    """Returns the hash of an element's content for a Content-Security-Policy."""
    digest = hashlib.sha256(content.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"
