"""Builds the document of a report: summary, sections, and provenance of the runs."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from jbench.report import headline, leaderboard, run_details, summary
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.comparisons import Comparison
from jbench.report.data.curves import FloatArray
from jbench.report.data.paths import RunPath
from jbench.report.data.published import PublishedCurve
from jbench.report.data.returns import TRAINING
from jbench.report.document import Document, FigureItem, Item, Section, TableItem
from jbench.report.figures import figure_items
from jbench.report.figures.behavior import Behavior
from jbench.report.request import Request
from jbench.report.tables import claim_items, reduction_items, table_items
from jbench.report.views import View

_SEEDS = (
    "Seeds are the only unit of replication: the episodes of a run are averaged first, so every "
    "statistic across seeds is computed from n numbers, one per seed. A percentile band shows the "
    "spread between seeds. An interval shows the uncertainty of the number itself."
)
_KINDS_TEXT = (
    "Training returns are those of the training episodes, exploration included, and are what the "
    "paper's curves show. Evaluation returns are those of the deterministic policy, evaluated "
    "regularly during training."
)
_SMOOTHING = (
    "Curves of training returns are smoothed in one of two orders. Quantile-first, the order of "
    "the paper's Figure 9, takes the quantiles across seeds in each episode and then averages them "
    "over a window of episodes, so its bands include the variation of single episodes. "
    "Smooth-first, the order of Figure 8, averages each seed over the window and then takes the "
    "quantiles across seeds, so its bands show how seeds differ and are narrower."
)
_CLAIMS = (
    "Each claim is tested by comparisons that were fixed before looking at any data, once with "
    "evaluation returns (deterministic policy) and once with training returns (exploration "
    "included). The published curves give only medians and bands of training returns, so most "
    "claims can't be decided from them; the remark says why."
)
_REDUCTION = (
    "Each representation is compared with full, the observation itself, and with scaled, the "
    "observation with the scaling that encoders apply to their inputs: a difference from scaled is "
    "due to reduction alone, and the difference between scaled and full to scaling alone. The "
    "tests are those of the paper's claims (a), (b) and (c). In brackets: the difference of the "
    "interquartile means (a, c) or the ratio of the standard deviations (b) with its interval (90% "
    "for a, 95% for b and c), for b the ratio that episodes alone would cause if all agents of a "
    "cell had the same expected return, and the seeds of the representation and of the baseline."
)
_RECORDED = ("processor", "cores", "threads", "jbench", "python")
_TESTS = [f"({letter}) {claim.text} {claim.test}" for letter, claim in CLAIMS.items()]


@dataclass(frozen=True)
class ReportData:
    """Data of a report.

    Attributes:
        views: one per kind of return, the leading one first; at least one.
        aggregate: points of our curves; see `summaries.aggregate_curves`.
        table: a row per cell; see `summaries.summary_table`.
        findings: on the claims; None if they were not requested.
        by_hand: (episodes,) returns of the hand-written policy of each task.
        runs: rows of the table `runs`.
        paths: of robots in evaluations, by source and run.
        notes: sentences for the reader.
        problems: sentences on unreadable records.
        encoders: errors of encoders; see `encoders.encoder_table`.
    """

    request: Request
    views: Sequence[View]
    published: Sequence[PublishedCurve]
    aggregate: pd.DataFrame
    table: pd.DataFrame
    findings: Sequence[Finding] | None
    by_hand: Mapping[str, FloatArray]
    runs: pd.DataFrame
    paths: Mapping[tuple[str, str], Sequence[RunPath]]
    notes: Sequence[str]
    problems: Sequence[str]
    encoders: pd.DataFrame = field(default_factory=pd.DataFrame)
    behaviors: Sequence[Behavior] = ()

    @property
    def comparisons(self) -> list[Comparison]:
        """Comparisons of cells with each other, for both kinds of return."""
        return [one for view in self.views for one in view.comparisons]


def document(data: ReportData) -> Document:
    """Returns the document of a report."""
    recorded = provenance(data.runs)
    sections = (
        _section("The paper's claims", [_CLAIMS, *_TESTS], _claims(data.findings)),
        _reduction(data),
        *(
            _section(
                f"Final {view.kind.plural}", [_SEEDS] if view.leads else [], _returns(view, data)
            )
            for view in data.views
        ),
        _section("Learning curves", [_KINDS_TEXT, _SMOOTHING], _curves(data, recorded)),
        _section("Comparisons", [], map(table_items.comparisons, data.views)),
        _section("Leaderboard", [], _leaderboard(data)),
        _section("Encoders", [], _encoders(data)),
        _section("What policies do", [], list(figure_items.of_behavior(data.behaviors))),
    )
    sides, overview = data.request.compare, _overview(data)
    return Document(
        title="Jitterbug: " + (" against ".join(sides) if sides else "what was learned"),
        summary=summary.sentences(data.request, data.views, data.findings, data.runs),
        problems=data.problems,
        notes=data.notes,
        # The text on smoothing also describes the curves of the overview.
        sections=[one for one in sections if one.items or (overview and _SMOOTHING in one.text)],
        provenance=recorded,
        command=data.request.command,
        headline=headline.headline(data.views[0]),
        overview=overview,
        inventory=headline.inventory(data.views),
        runs=run_details.details(data.views, data.runs, data.paths),
    )


def _section(
    title: str, text: Sequence[str], items: Iterable[Item | None], answers: Sequence[str] = ()
) -> Section:
    return Section(title, text, [item for item in items if item is not None], answers)


def tables(document: Document) -> list[TableItem]:
    """Returns all tables of a document."""
    return [item for item in document.items if isinstance(item, TableItem)]


def provenance(runs: pd.DataFrame) -> pd.DataFrame:
    """Returns the provenance of each run.

    Columns: run, source (if there are several), status, begun (UTC), wall time (s), processor,
    cores, threads, jbench, python, versions of packages, git revision, command.
    """
    rows = []
    for row in runs.to_dict("records"):
        recorded = json.loads(row["provenance"])
        recorded = recorded if isinstance(recorded, dict) else {}
        packages, command = recorded.get("packages"), recorded.get("command")
        versions = packages.items() if isinstance(packages, dict) else ()
        if isinstance(command, list):
            command = " ".join(map(str, command))
        rows.append(
            {
                "run": row["run"],
                **({"source": row["source"]} if "source" in row else {}),
                "status": row["status"],
                "begun": row["created"],
                "wall time (s)": row["wall_time"],
                **{name: _text(recorded.get(name)) for name in _RECORDED},
                **{str(name): _text(version) for name, version in versions},
                "git revision": _text(recorded.get("git_revision")),
                "command": _text(command),
            }
        )
    return pd.DataFrame(rows)


def _text(value: Any) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value)


def _returns(view: View, data: ReportData) -> list[Item | None]:
    """Returns the tables of final returns of one kind, with figures for the leading kind."""
    if not view.learned:
        return []
    return [
        table_items.final_returns(view),
        *(figure_items.of_returns(view) if view.leads else ()),
        table_items.returns_of_cells(view, data.published),
        table_items.spreads(view),
        table_items.learning_speed(view),
    ]


def _reduction(data: ReportData) -> Section:
    answers, *others = (reduction_items.sentences(view.reductions) for view in data.views)
    figures = [item for v in data.views for item in figure_items.of_reduction(v, data.encoders)]
    text = [_REDUCTION, *(one for sentences in others for one in sentences)]
    items = [*figures, *map(reduction_items.table, data.views)]
    return _section("Does reduction help?", text, items, answers)


def _overview(data: ReportData) -> list[FigureItem]:
    """Returns the figures that are shown first, of the leading kind of return."""
    request, view = data.request, data.views[0]
    trained = [cell for one in data.views if one.kind is TRAINING for cell in one.cells]
    return [
        *figure_items.of_tasks(view, data.published, data.aggregate, request),
        *figure_items.of_uncertainty(view, trained, data.published),
    ]


def _curves(data: ReportData, recorded: pd.DataFrame) -> list[Item]:
    request, aggregate = data.request, data.aggregate
    curves = [
        item
        for view in data.views
        for item in figure_items.of_curves(view, data.published, aggregate, request)
    ]
    return [*curves, *figure_items.of_time(data.views[0], recorded)]


def _leaderboard(data: ReportData) -> list[Item]:
    """Returns the leaderboard by the leading kind of return; a comparison has none."""
    view, request = data.views[0], data.request
    if request.compare is not None:
        return []
    ranked = leaderboard.entries(view.statistics, data.by_hand, data.published, request.algo)
    return [leaderboard.table(ranked, view.kind)] if ranked else []


def _claims(findings: Sequence[Finding] | None) -> list[Item | None]:
    if findings is None:
        return []
    return [claim_items.verdicts(findings), claim_items.findings_table(findings)]


def _encoders(data: ReportData) -> list[Item]:
    if data.encoders.empty:
        return []
    figures = figure_items.of_encoders(data.encoders)
    return [*figures, table_items.encoder_errors(data.encoders)]
