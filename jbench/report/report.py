"""From a results directory to a report's files."""

import csv
import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow.csv import WriteOptions, write_csv

from jbench.errors import RequestError
from jbench.report import contents, output_directory, page, sources, views
from jbench.report.analysis import (
    claims,
    comparisons,
    heuristics,
    published_claims,
    reduction,
    scores,
)
from jbench.report.contents import Material
from jbench.report.data import summaries
from jbench.report.data.cells import Cell, of_kind
from jbench.report.data.published import PublishedCurve, read_published, read_sequences
from jbench.report.data.returns import TRAINING
from jbench.report.document import Document, FigureItem
from jbench.report.figures import behaviour, encoders, plotting, processor
from jbench.report.figures.layout import SHEETS
from jbench.report.request import Request
from jbench.report.sources import Source
from jbench.report.tables import files
from jbench.store import query
from jbench.store.database import Results
from jbench.store.shipped import shipped

_DEFAULT = Request()


@dataclass(frozen=True)
class Report:
    """What was reported, and where it lies.

    Attributes:
        table: a row for each cell, in the order of the paper; see `summaries.summary_table`.
        aggregate: a row for each point of each curve; see `summaries.aggregate_curves`.
        findings: on the paper's claims; None if they were not asked for.
        comparisons: of cells with each other, by both kinds of return.
        compares: whether two sides are compared.
        document: the report itself.
        figures: the figures' files.
        files: all files written, figures and page among them.
        problems: a sentence for each part of the results that can't be read; the rest is reported.
        notes: a sentence for each thing that a reader of the curves should know.
    """

    table: pd.DataFrame
    aggregate: pd.DataFrame
    findings: Sequence[claims.Finding] | None
    comparisons: Sequence[comparisons.Comparison]
    compares: bool
    document: Document
    figures: list[Path]
    files: list[Path]
    problems: Sequence[str]
    notes: Sequence[str]


def write_report(results: Results, out: Path, request: Request = _DEFAULT) -> Report:
    """Aggregates all runs over their seeds and writes tables, figures and a page.

    Args:
        results: where the runs are.
        out: directory for the files; made if need be.
        request: what the report shall hold.

    Raises:
        RequestError: if there are no runs, or none that the filters let through; or if nothing can
            be written in `out`.
        WorkError: if there are runs, but none can be read; or the disk is full.
    """
    made_of = gather(results, request)
    document = contents.document(made_of)
    files = {**_data_files(made_of), **_table_files(document), **_figure_files(document, request)}
    drawn = {f"{item.name}.{ending}" for item in _figures(document) for ending in request.formats}
    made = page.render_document(document, sheet=SHEETS[request.columns], reloads=request.watched)
    files["index.html"] = made.encode()
    paths, left = output_directory.write(out, files)
    return Report(
        table=made_of.table,
        aggregate=made_of.aggregate,
        findings=made_of.findings,
        comparisons=made_of.comparisons,
        compares=request.compare is not None,
        document=document,
        figures=[path for path in paths if path.name in drawn],
        files=paths,
        problems=made_of.problems,
        notes=[*made_of.notes, *left],
    )


def gather(results: Results, request: Request) -> Material:
    """Returns all that the report of some results is made of; `write_report`."""
    if request.compare is not None:
        one, other = (sources.side(text, results, request) for text in request.compare)
        names = {name for text in request.compare for name in sources.names_of(text)}
        notes = _check_comparable(one, other, names)

        def compare(sides: Sequence[Sequence[Cell]]) -> list[comparisons.Comparison]:
            return comparisons.across(sides[0], sides[1], names)

        return _material([one, other], compare, notes, request)
    own = sources.own(results, request)
    seen, unread = behaviour.behaviours(results, request.task)
    reduced = encoders.encoder_table(own.tables, request.task)
    all_of_them = [
        own,
        *([sources.reference(request, shipped())] if request.reference else []),
    ]
    # Policies that were only evaluated, and encoders, can be drawn without any run.
    drawable = bool(seen) or not reduced.empty or any(s.cells for s in all_of_them[1:])
    if own.runs.empty and (request.algo is not None or not drawable):
        raise sources.nothing_to_report(results, own.problems)
    if not own.cells and not drawable:
        raise sources.NothingYetError(
            f"No run has an episode yet; wait for them. {' '.join(own.notes)}"
        )
    return _material(all_of_them, views.compare_within, [], request, reduced, seen, unread)


def _check_comparable(one: Source, other: Source, names: Collection[str]) -> list[str]:
    """Returns what is said of cells of two sources that have no counterpart in the other.

    Raises:
        RequestError: if none has.
    """
    ours, theirs = (of_kind(source.cells, TRAINING) for source in (one, other))
    found = comparisons.across(ours, theirs, names)
    notes = comparisons.near_misses(ours, theirs, found)
    if not found:
        typed = (
            f" but {', '.join(sorted(names))}, seeds and steps" if names else " but seeds and steps"
        )
        raise RequestError(
            f"Nothing of {one.name} can be compared with anything of {other.name}: there must be "
            f"runs of both that differ in nothing{typed}. {notes[0] if notes else ''}".strip()
        )
    return [*(note for cells in (ours, theirs) for note in comparisons.alone(cells, found)), *notes]


def _material(
    all_of_them: Sequence[Source],
    compare: views.Compare,
    told: Sequence[str],
    request: Request,
    reduced: pd.DataFrame | None = None,
    seen: Sequence[behaviour.Behaviour] = (),
    unread: Sequence[str] = (),
) -> Material:
    table = query.published()
    # The figures choose from these by the paper's figure.
    published = [*read_published(table), *read_sequences(table)]
    shown = views.views_of([s.cells for s in all_of_them], published, request, compare)
    learned = [item for view in shown for item in view.learned]
    notes = [*views.missing_evaluations(shown, request)]
    notes += [note for source in all_of_them for note in source.notes]
    notes += [*told, *processor.left_out(shown[0].cells)]
    notes += summaries.sentences(learned, published, request.window)
    findings = None
    if request.claims:
        findings, more = _findings(shown, published, all_of_them[0], request)
        notes += more
    return Material(
        request=request,
        views=shown,
        published=published,
        aggregate=summaries.aggregate_curves(learned),
        table=summaries.summary_table(learned, published, request.window),
        findings=findings,
        encoders=pd.DataFrame() if reduced is None else reduced,
        seen=seen,
        runs=_runs(all_of_them),
        notes=notes,
        problems=[*(problem for source in all_of_them for problem in source.problems), *unread],
    )


def _runs(all_of_them: Sequence[Source]) -> pd.DataFrame:
    """Returns the runs of all sources; whose they are, if there are several."""
    if len(all_of_them) == 1:
        return all_of_them[0].runs
    return pd.concat([s.runs.assign(source=s.name) for s in all_of_them], ignore_index=True)


def _findings(
    shown: Sequence[views.View],
    published: Sequence[PublishedCurve],
    own: Source,
    request: Request,
) -> tuple[list[claims.Finding], list[str]]:
    """Returns what is found of the claims, in their order, and notes on what is not."""
    by_hand, notes = heuristics.findings(own.tables, request.task)
    chosen = [
        curve
        for curve in published
        if request.task in (None, curve.task) and request.algo in (None, curve.algo, "ppo")
    ]
    ours = [finding for view in shown for finding in view.findings]
    found = [*ours, *by_hand, *published_claims.examine_published(chosen)]
    return sorted(found, key=lambda finding: finding.claim), notes


def _data_files(made_of: Material) -> dict[str, bytes]:
    """Returns the exact numbers behind the figures and tables."""
    frames = {"aggregate": made_of.aggregate, "table": made_of.table}
    statistics = [one for view in made_of.views for one in view.statistics]
    if statistics:
        frames["seed_statistics"] = scores.statistics_frame(statistics)
    if made_of.comparisons:
        frames["seed_comparisons"] = comparisons.comparisons_frame(made_of.comparisons)
    groups = [group for view in made_of.views for group in view.groups]
    if groups:
        frames["reduction"] = reduction.frame(groups)
    if made_of.findings is not None:
        frames["findings"] = claims.findings_frame(made_of.findings)
    if not made_of.encoders.empty:
        frames["encoders"] = made_of.encoders
    files = {f"{name}.csv": _to_csv(frame) for name, frame in frames.items()}
    return {"aggregate.parquet": _to_parquet(made_of.aggregate), **files}


def _table_files(document: Document) -> dict[str, bytes]:
    return {
        f"{item.name}.{ending}": make(item).encode()
        for item in contents.tables(document)
        for ending, make in files.FORMATS.items()
    }


def _figure_files(document: Document, request: Request) -> dict[str, bytes]:
    files = {}
    for item in _figures(document):
        drawn = plotting.draw(item.figure, SHEETS[request.columns])
        for ending in request.formats:
            files[f"{item.name}.{ending}"] = plotting.FORMATS[ending](drawn)
    return files


def _figures(document: Document) -> list[FigureItem]:
    items = (item for section in document.sections for item in section.items)
    return [item for item in items if isinstance(item, FigureItem)]


def _to_csv(frame: pd.DataFrame) -> bytes:
    """Returns the rows as CSV with a header; pyarrow is ten times as fast at it as pandas."""
    header, rows = io.StringIO(), io.BytesIO()
    csv.writer(header, lineterminator="\n").writerow(frame.columns)
    table = pa.Table.from_pandas(frame, preserve_index=False, nthreads=1)
    write_csv(table, rows, WriteOptions(include_header=False, quoting_style="needed"))
    return header.getvalue().encode() + rows.getvalue()


def _to_parquet(frame: pd.DataFrame) -> bytes:
    sink = io.BytesIO()
    rows = pa.Table.from_pandas(frame, preserve_index=False, nthreads=1)
    pq.write_table(rows, sink, compression="zstd")
    return sink.getvalue()
