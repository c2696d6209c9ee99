"""The page of a report: one HTML file that loads nothing, made by templates."""

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup
from matplotlib.markers import MarkerStyle

from jbench.paper import CITATION
from jbench.report import style
from jbench.report.data.source_names import IMPORTED
from jbench.report.encoders import descriptions
from jbench.report.figures.chart import Chart
from jbench.report.frames import Frames
from jbench.report.repetition import drops, repetition
from jbench.report.run_details import run_details
from jbench.report.sides import named_sides
from jbench.report.svg import panel_svgs
from jbench.report.table import Column, Table
from jbench.report.tables import notes, tables
from jbench.report.texts import clean
from jbench.report.verdict_matrices import verdict_matrices
from jbench.representation_names import MEANINGS, kind_in
from jbench.wording import counted

_ROWS_BEFORE_FOLD = 2  # of panels of a figure; a click shows the others
_FILTERED = ("task", "algo", "representation", "against", "returns", "status", "claim")
"""Columns of long tables by whose values rows can be chosen."""


def render(frames: Frames, made: Sequence[Chart]) -> str:
    """Returns the page with these figures as HTML; the same frames give the same bytes.

    Its policy allows only its own style and script, so that a text in the results can't become a
    script and nothing is loaded or sent. It is readable without scripts.
    """
    return _template().render(
        frames=frames,
        notes=notes(frames),
        title=_title(frames),
        charts={chart.name: chart for chart in made},
        panel_svgs=panel_svgs,
        mark=_mark,
        rows_before_fold=_ROWS_BEFORE_FOLD,
        filtered=_FILTERED,
        soft=style.SOFT,
        meanings=_meanings(frames),
        matrices=verdict_matrices(frames),
        tables=[_shown(table) for table in tables(frames) if table.name != "verdicts"],
        drops=drops(frames.runs, frames.source.problems),
        repeat=repetition(frames.source, frames.results),
        runs=asdict(run_details(frames)),
        command=clean(frames.request.command),
        citation=CITATION if (frames.published["source"] != IMPORTED).any() else "",
    )


@cache
def _template() -> Template:
    """Returns the template, which has the policy, the style and the script of each page."""
    loader = PackageLoader("jbench.report")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "ensure_ascii": False}
    policy = "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'"
    assets: dict[str, str] = {}
    for kind, name in (("style", "style.css"), ("script", "page.js")):
        assets[kind] = Markup(f"\n{loader.get_source(environment, name)[0]}")
        digest = hashlib.sha256(assets[kind].encode()).digest()
        policy += f"; {kind}-src 'sha256-{base64.b64encode(digest).decode()}'"

    return environment.get_template("page.html.j2", globals={"policy": policy, **assets})


def _shown(table: Table) -> tuple[Table, str, list[Column], list[list[tuple[Any, str]]]]:
    """Returns a table, its caption, and its columns and rows with any text."""
    columns, rows = table.shown
    return table, table.explained(columns), columns, rows


def _title(frames: Frames) -> str:
    """Returns the title of the page: what is compared, or what the curves are of."""
    if frames.request.compare:
        return clean(named_sides(frames.request.compare).together)

    about = "jbench"
    names = frames.configurations["configuration"]
    if frames.request.curves is not None:
        about = clean(frames.request.curves.resolve().name)
        names = frames.runs["configuration"]

    count = counted(names.nunique(), "configuration")
    return f"{about}: {counted(len(frames.runs), 'run')}, {count}"


def _mark(marker: str) -> str:
    """Returns the outline of a marker in the middle of a legend's line, for SVG; none for ""."""
    drawn = MarkerStyle(marker)
    lines: list[Any] = drawn.get_path().transformed(drawn.get_transform()).to_polygons()
    corners = (" ".join(f"{18 + 7 * x:.1f},{5 - 7 * y:.1f}" for x, y in line) for line in lines)
    return "".join(f"M{points}z" for points in corners)


def _meanings(frames: Frames) -> list[tuple[str, str]]:
    """Returns what the representations of the curves mean, if there are several."""
    names = [str(name) for name in frames.curves["representation"].unique()]
    endings = [name for name in MEANINGS if name[0] == "-" and name in " ".join(names)]
    known = dict.fromkeys((*map(kind_in, names), *endings) if len(names) > 1 else ())
    meanings = {**descriptions(frames.source.tables), **MEANINGS}
    return [(name, clean(meanings[name]).rstrip(".")) for name in known if name in meanings]
