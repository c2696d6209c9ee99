"""The page of a report: one HTML file that loads nothing, made by templates."""

import base64
import hashlib
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.markers import MarkerStyle

from jbench.names import MEANINGS, kind_in
from jbench.paper.citation import CITATION
from jbench.report import style
from jbench.report.analysis.claims import MARGIN
from jbench.report.data.configuration import OWN
from jbench.report.data.returns import clean, rounded
from jbench.report.figures.chart import Chart
from jbench.report.frames import Frames
from jbench.report.runs import run_details
from jbench.report.svg import panel_svgs
from jbench.report.table import Column, Table
from jbench.report.tables import COMPARED, tables
from jbench.statistics.bootstrap import DECIDING_SEEDS
from jbench.wording import counted

_FIRST, _NEXT = ("comparisons", "representations"), ("algorithms", "returns")
_OPEN_TABLES = ("final_returns", "comparisons", "runs")
_FILTERED = ("task", "algo", "representation", "against", "returns", "status", "claim")
_MOST_CHOICES = 40
_LONG = 30  # rows from which a table has a height of its own
_WIDE = 10  # columns above which intervals stand below their numbers
_SEARCHED = 12  # rows from which a table has filters
_STATES = {"✓": "for", "✗": "against"}


def render(frames: Frames, made: Sequence[Chart]) -> str:
    """Returns the page with these figures as HTML; the same frames give the same bytes.

    Its policy allows only its own style and script, so that a text in the results can't become a
    script and nothing is loaded or sent. It is readable without scripts.
    """
    drawn = {chart.name: _figure(chart) for chart in made}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("jbench.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "ensure_ascii": False}
    css, script = _asset("style.css"), _asset("page.js")
    policy = (
        f"default-src 'none'; style-src {_digest(css)}; script-src {_digest(script)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    shown = frames.run_curves, frames.metrics, frames.paths
    runs = run_details(frames.runs, *shown, frames.returns)
    return environment.get_template("page.html.j2").render(
        policy=policy,
        style=Markup(css),
        script=Markup(script),
        watched=frames.request.watched,
        title=_title(frames),
        headline=frames.headline,
        problems=frames.problems,
        notes=frames.notes,
        first=[drawn[name] for name in _FIRST if name in drawn],
        next=[drawn[name] for name in _NEXT if name in drawn],
        folded=[drawn[name] for name in drawn if name not in (*_FIRST, *_NEXT)],
        meanings=_meanings(frames),
        matrix=verdict_matrix(frames),
        tables=[_table(table) for table in tables(frames) if table.name != "verdicts"],
        provenance=list(frames.provenance.itertuples(index=False, name=None)),
        runs=runs,
        command=clean(frames.request.command),
        citation=CITATION if len(frames.published) else "",
    )


def _title(frames: Frames) -> str:
    if frames.request.compare:
        return " against ".join(clean(side) for side in frames.request.compare)
    about, names = "jbench", frames.configurations["configuration"]
    if frames.request.curves is not None:
        about, names = clean(frames.request.curves.name), frames.runs["configuration"]
    count = counted(names.nunique(), "configuration")
    return f"{about}: {counted(len(frames.runs), 'run')}, {count}"


def _figure(chart: Chart) -> dict[str, Any]:
    panels = []
    for i, panel in enumerate(chart.panels):
        label = f"{chart.title}: {panel.title}. {chart.note}"
        svg = Markup(panel_svgs(panel, label, f"{chart.name}-{i}"))
        panels.append({"title": panel.title, "svg": svg})
    legend = {
        name: {
            "stroke": "var(--soft)" if look.color == style.SOFT else look.color,
            "dash": " ".join(f"{length * 1.6:g}" for length in look.dash),
            "mark": _mark(look.marker),
        }
        for name, look in chart.legend.items()
    }
    classes = [shown for shown, _ in chart.switches] + (["single"] if len(panels) == 1 else [])
    legend = legend if len(legend) > 1 else {}
    return {**vars(chart), "panels": panels, "legend": legend, "shown": " ".join(classes)}


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
    return [(name, MEANINGS[name]) for name in known if name in MEANINGS]


def verdict_matrix(frames: Frames) -> dict[str, Any]:
    """Returns the verdicts with a row for each representation, and a column for each claim."""
    verdicts = frames.lead(frames.verdicts)
    baselines = list(dict.fromkeys(verdicts["against"]))
    scales = {claim: _scale(rows) for claim, rows in verdicts.groupby("claim")}
    claims = {claim: title for claim, title in COMPARED.items() if claim in scales}
    rows = []
    for _, group in verdicts.groupby("configuration", sort=False):
        first = group.iloc[0]
        known = {(row["against"], row["claim"]): row for row in group.to_dict("records")}
        keys = [(name, claim) for name in baselines for claim in claims]
        shown = [_verdict(known[k], scales[k[1]]) if k in known else None for k in keys]
        source = "" if first["source"] == OWN else first["source"]
        about = ", ".join(filter(None, (first["algo"], first["words"], first["task"], source)))
        rows.append({"representation": first["representation"], "about": about, "verdicts": shown})
    return {"baselines": baselines, "claims": claims, "rows": rows}


def _scale(rows: pd.DataFrame) -> float:
    """Returns half of the width of the small axis of a claim; few intervals reach beyond it."""
    ends = np.abs(rows[["low", "high"]].to_numpy(float))
    return float(np.quantile(known, 0.9)) if len(known := ends[np.isfinite(ends)]) else 1.0


def _verdict(row: Mapping[Any, Any], reach: float) -> dict[str, Any]:
    """Returns a verdict with the places of its intervals on a small axis, 120 wide."""

    def at(value: float) -> float:
        share = min(max(value / (reach or 1), -1), 1)
        return round(60 + 56 * (0 if math.isnan(share) else share), 1)

    value, low, high = (rounded(row[name]) for name in ("value", "low", "high"))
    enough = row["seeds"] >= DECIDING_SEEDS and np.isfinite(row["corrected_low"])
    undecided = "undecided" if enough else counted(row["seeds"], "seed")
    names = ("value", "low", "high", "corrected_low", "corrected_high")
    return {
        **row,
        **{name: at(row[name]) for name in names},
        "verdict": undecided if row["verdict"] == "undecided" else row["verdict"],
        "size": "" if np.isnan(row["value"]) else value,
        "numbers": f"uncorrected: {value} [{low}, {high}], {row['seeds']} seeds",
        "state": _STATES.get(row["mark"], "for" if row["verdict"] == "similar" else "open"),
        "margin": (at(-MARGIN), at(MARGIN)) if row["claim"] == "a" else None,
    }


def _table(table: Table) -> dict[str, Any]:
    columns, rows = table.shown()
    filters = []
    for i, column in enumerate(columns):
        values = list(dict.fromkeys(row[i][1] for row in rows))
        if column.key in _FILTERED and 1 < len(values) <= _MOST_CHOICES:
            filters.append((i, column.title, values))
    cells = [[_cell(*pair) for pair in zip(columns, row, strict=True)] for row in rows]
    return {
        **vars(table),
        **{"columns": columns, "rows": cells, "filters": filters},
        "searched": len(rows) > _SEARCHED,
        "long": len(rows) > _LONG,
        "stacked": len(columns) > _WIDE,
        "folded": table.name not in _OPEN_TABLES,
    }


def _cell(column: Column, cell: tuple[Any, str]) -> dict[str, Any]:
    """Returns the text of a cell, its interval apart, and the value that sorts it, if known."""
    value, text = cell
    number, bracket, ends = text.partition(" [") if column.numeric else (text, "", "")
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    known = is_number and not math.isnan(value)
    return {
        **{"text": number, "interval": f"[{ends}" if bracket else "", "title": column.title},
        **{"numeric": column.numeric, "value": float(f"{value:.6g}") if known else ""},
    }


def _asset(name: str) -> str:
    text = resources.files("jbench.report").joinpath("templates", name).read_text("utf-8")
    return f"\n{text}"


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
