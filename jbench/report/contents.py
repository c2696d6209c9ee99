"""The document of a report: what it says first, its sections, and where each run comes from."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from jbench.report import summary
from jbench.report.analysis.claims import CLAIMS, Finding
from jbench.report.analysis.comparisons import Comparison
from jbench.report.data.published import PublishedCurve
from jbench.report.document import Document, Item, Section, TableItem
from jbench.report.figures import figure_items
from jbench.report.figures.behaviour import Behaviour
from jbench.report.request import Request
from jbench.report.tables import claim_items, reduction_items, table_items
from jbench.report.views import View

_SEEDS = (
    "A seed is the only thing that is repeated: all episodes of a run are averaged first, and "
    "every number across seeds is of as many numbers as there are seeds, n. A percentile band is "
    "spread: where the seeds are. An interval is uncertainty: where the number itself could be."
)
_KINDS_TEXT = (
    "Training returns are those of the training episodes, exploration included, and are what the "
    "paper's curves show. Evaluation returns are those of the deterministic policy, tested now and "
    "then during training."
)
_SMOOTHING = (
    "Curves of training returns are smoothed in one of two orders. Quantile-first, the order of "
    "the paper's Figure 9, takes the quantiles across seeds in each episode and then averages them "
    "over a window of episodes, so its bands hold the ups and downs of single episodes too. "
    "Smooth-first, the order of Figure 8, averages each seed over the window and then takes the "
    "quantiles across seeds, so its bands show how seeds differ and are narrower."
)
_CLAIMS = (
    "Each claim is tested by comparisons that were fixed before any data were looked at: once of "
    "evaluation returns, of the deterministic policy, and once of training returns, exploration "
    "included. Of the published curves, of training returns, only medians and bands are known, so "
    "most of what the paper claims can't be decided from them: the remark says why."
)
_REDUCTION = (
    "Each representation is compared with full, the observation itself, and with scaled, the "
    "observation with the scaling that encoders give their inputs: a difference from scaled is of "
    "reduction alone. The tests are those of the paper's claims (a), (b) and (c). In brackets: the "
    "difference of the interquartile means (a, c) or the ratio of the standard deviations (b) with "
    "its interval (90% for a, 95% for b and c), and the seeds of the representation and of the "
    "baseline."
)
_TESTS = [f"({letter}) {claim.text} {claim.test}" for letter, claim in CLAIMS.items()]


@dataclass(frozen=True)
class Material:
    """All that a report is made of.

    Attributes:
        request: what was asked for.
        views: of each kind of return that there is, the leading one first; at least one.
        published: the paper's curves.
        aggregate: points of our curves, as `summaries.aggregate_curves` returns them.
        table: a row for each cell, as `summaries.summary_table` returns it.
        findings: on the claims; None if they were not asked for.
        encoders: errors of encoders, as `encoders.encoder_table` returns them.
        seen: states of policies.
        runs: rows of the table `runs`.
        notes: sentences for a reader.
        problems: sentences on what can't be read.
    """

    request: Request
    views: Sequence[View]
    published: Sequence[PublishedCurve]
    aggregate: pd.DataFrame
    table: pd.DataFrame
    findings: Sequence[Finding] | None
    encoders: pd.DataFrame
    seen: Sequence[Behaviour]
    runs: pd.DataFrame
    notes: Sequence[str]
    problems: Sequence[str]

    @property
    def comparisons(self) -> list[Comparison]:
        """The comparisons of cells with each other, by both kinds of return."""
        return [one for view in self.views for one in view.comparisons]


def document(made_of: Material) -> Document:
    """Returns the document of a report."""
    compared = _present(map(table_items.comparisons, made_of.views))
    sections = (
        Section("Does reduction help?", _answers(made_of.views), _reduction(made_of)),
        *(
            Section(
                f"Final {view.kind.plural}", [_SEEDS] if view.leads else [], _returns(view, made_of)
            )
            for view in made_of.views
        ),
        Section("Learning curves", [_KINDS_TEXT, _SMOOTHING], _curves(made_of)),
        Section("Comparisons", [], compared),
        Section("The paper's claims", [_CLAIMS, *_TESTS], _claims(made_of)),
        Section("Encoders", [], _encoders(made_of)),
        Section(
            "What policies do",
            [],
            list(figure_items.of_behaviour(made_of.seen)),
        ),
    )
    sides = made_of.request.compare
    return Document(
        title="Jitterbug: " + (" against ".join(sides) if sides else "what was learned"),
        summary=summary.sentences(made_of.request, made_of.views, made_of.findings, made_of.runs),
        problems=made_of.problems,
        notes=made_of.notes,
        sections=[section for section in sections if section.items],
        provenance=provenance(made_of.runs),
        command=made_of.request.command,
    )


def tables(of: Document) -> list[TableItem]:
    """Returns all tables of a document."""
    items = (item for section in of.sections for item in section.items)
    return [item for item in items if isinstance(item, TableItem)]


def provenance(runs: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each run: where it comes from.

    Columns: run, source (where there are several), status, begun (UTC), wall time (s), processor,
    cores, threads, jbench, python, the versions of packages, git revision, command.
    """
    rows = []
    for row in runs.to_dict("records"):
        recorded = json.loads(row["provenance"])
        recorded = recorded if isinstance(recorded, dict) else {}
        packages = recorded.get("packages")
        command = recorded.get("command")
        rows.append(
            {
                "run": row["run"],
                **({"source": row["source"]} if "source" in row else {}),
                "status": row["status"],
                "begun": row["created"],
                "wall time (s)": row["wall_time"],
                **{name: _text(recorded.get(name)) for name in ("processor", "cores", "threads")},
                **{name: _text(recorded.get(name)) for name in ("jbench", "python")},
                **(
                    {str(name): _text(version) for name, version in packages.items()}
                    if isinstance(packages, dict)
                    else {}
                ),
                "git revision": _text(recorded.get("git_revision")),
                "command": " ".join(map(str, command))
                if isinstance(command, list)
                else _text(command),
            }
        )
    return pd.DataFrame(rows)


def _text(value: Any) -> str:
    return "" if value is None else value if isinstance(value, str) else json.dumps(value)


def _returns(view: View, made_of: Material) -> list[Item]:
    """Returns the tables of the final returns of one kind, and the figures of the leading one."""
    if not view.learned:
        return []
    drawn = figure_items.of_returns(view) if view.leads else ()
    return [
        table_items.final_returns(view),
        *drawn,
        *_present(
            [
                table_items.returns_of_cells(view, made_of.published),
                table_items.spreads(view),
                table_items.learning_speed(view),
            ]
        ),
    ]


def _answers(views: Sequence[View]) -> list[str]:
    """Returns what the representations do, a sentence for each claim and kind of return."""
    said = [one for view in views for one in reduction_items.sentences(view.reductions, view.kind)]
    return [_REDUCTION, *said]


def _reduction(made_of: Material) -> list[Item]:
    drawn = [item for view in made_of.views for item in figure_items.of_reduction(view)]
    tables = (
        reduction_items.table(view.reductions, view.kind, view.file("reduction_tests"))
        for view in made_of.views
    )
    return [*drawn, *_present(tables)]


def _curves(made_of: Material) -> list[Item]:
    request, aggregate = made_of.request, made_of.aggregate
    curves = [
        item
        for view in made_of.views
        for item in figure_items.of_curves(view, made_of.published, aggregate, request)
    ]
    return [*curves, *figure_items.of_time(made_of.views[0], made_of.runs)]


def _claims(made_of: Material) -> list[Item]:
    if made_of.findings is None:
        return []
    findings = made_of.findings
    return _present([claim_items.verdicts(findings), claim_items.findings_table(findings)])


def _encoders(made_of: Material) -> list[Item]:
    if made_of.encoders.empty:
        return []
    drawn = figure_items.of_encoders(made_of.encoders)
    return [*drawn, table_items.encoder_errors(made_of.encoders)]


def _present(items: Iterable[TableItem | None]) -> list[Item]:
    return [item for item in items if item is not None]
