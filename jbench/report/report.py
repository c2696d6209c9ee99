"""Writes the report of a results directory."""

import csv
import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow.csv import WriteOptions, write_csv

from jbench.cores import cores
from jbench.errors import RequestError
from jbench.report import contents, leaderboard, output_directory, page, parallel, sources, views
from jbench.report.analysis import (
    claims,
    comparisons,
    heuristics,
    published_claims,
    reduction,
    scores,
)
from jbench.report.contents import ReportData
from jbench.report.data import summaries
from jbench.report.data.cells import of_kind, verified
from jbench.report.data.published import PublishedCurve, read_published, read_sequences
from jbench.report.data.returns import TRAINING
from jbench.report.document import Document, FigureItem
from jbench.report.figures import behavior, encoders, plotting, processor
from jbench.report.figures.layout import SHEETS
from jbench.report.request import Request
from jbench.report.sources import Source
from jbench.report.tables import files
from jbench.store import query
from jbench.store.database import Results
from jbench.store.files import make_directory
from jbench.store.shipped import shipped_results

_DEFAULT = Request()


@dataclass(frozen=True)
class Report:
    """A written report.

    Attributes:
        data: its notes also name files that were kept.
    """

    data: ReportData
    document: Document
    files: list[Path]


def write_report(results: Results, out: Path, request: Request = _DEFAULT) -> Report:
    """Aggregates all runs over their seeds and writes tables, figures and a page.

    Args:
        out: directory for the files; created if it does not exist.

    Raises:
        RequestError: if there are no runs, none passes the filters, or `out` is not writable.
        WorkError: if there are runs but none can be read, or the disk is full.
    """
    data = gather(results, request)
    pa.default_memory_pool().release_unused()  # memory of the rows that were read
    make_directory(out)  # before the figures are drawn, since it may raise an error
    document = contents.document(data)
    drawn = [item for item in document.items if isinstance(item, FigureItem)]
    tasks = [
        partial(_data_files, data),
        partial(_table_files, document),
        *(partial(_figure_files, item, request) for item in drawn),
        partial(_page, document, request),
    ]
    if request.watched:
        # The user only looks at the page. A single task runs in this process, which remembers the
        # drawn panels.
        tasks = tasks[-1:]
    paths, kept = output_directory.write(out, parallel.files_of(tasks, cores()))
    return Report(
        data=replace(data, notes=[*data.notes, *kept]),
        document=document,
        files=paths,
    )


def gather(results: Results, request: Request) -> ReportData:
    """Returns the data of a report; see `write_report`."""
    if request.compare is not None:
        one, other = (sources.side(text, results, request) for text in request.compare)
        notes = _check_comparable(one, other, request.names_compared)
        return _report_data([one, other], notes, request)
    own, *imported = sources.own_and_imported(results, request)
    behaviors, unread = behavior.behaviors(results, request.task)
    encoder_table = encoders.encoder_table(own.tables, request.task)
    reported = [own, *imported]
    reported += [sources.reference(request, shipped_results())] if request.reference else []
    if request.baseline is not None:
        sources.check_baseline(request.baseline, reported)
    # Evaluated policies and encoders can be drawn without any run.
    drawable = bool(behaviors) or not encoder_table.empty or any(s.cells for s in reported[1:])
    selected = request.algo is None or any(source.cells for source in imported)
    if own.runs.empty and not (selected and drawable):
        unreadable = [problem for source in (own, *imported) for problem in source.problems]
        raise sources.nothing_to_report(results, unreadable)
    if not own.cells and not drawable:
        raise sources.NothingYetError(
            f"No run has an episode yet; wait for them. {' '.join(own.notes)}"
        )
    data = _report_data(reported, [], request)
    problems = [*data.problems, *unread]
    return replace(data, encoders=encoder_table, behaviors=behaviors, problems=problems)


def _check_comparable(one: Source, other: Source, names: Collection[str]) -> list[str]:
    """Returns notes on cells of two sources without a counterpart in the other.

    Raises:
        RequestError: if no cell has a counterpart.
    """
    ours, theirs = (of_kind(source.cells, TRAINING) for source in (one, other))
    pairs = comparisons.across(ours, theirs, names)
    notes = comparisons.near_misses(ours, theirs, pairs)
    if not pairs:
        free = ", ".join([*sorted(names), "seeds and steps"])
        raise RequestError(
            f"No runs of {one.name} and {other.name} can be compared: there must be runs of both "
            f"that differ only in {free}. {notes[0] if notes else ''}".strip()
        )
    return [*(note for cells in (ours, theirs) for note in comparisons.alone(cells, pairs)), *notes]


def _report_data(
    reported: Sequence[Source],
    more_notes: Sequence[str],
    request: Request,
) -> ReportData:
    """Returns the data of a report without encoders and behaviors."""
    table = query.published()
    # Figures select from these by the number of the paper's figure.
    published = [*read_published(table), *read_sequences(table)]
    shown = views.views_of([s.cells for s in reported], published, request)
    learned = [item for view in shown for item in view.learned]
    findings, untested = _findings(shown, published, reported[0], request)
    notes = [
        *views.missing_evaluations(shown, request),
        *(note for source in reported for note in source.notes),
        *more_notes,
        *processor.left_out(verified(shown[0].cells)),
        *summaries.sentences(learned, published, request.window),
        *untested,
    ]
    return ReportData(
        request=request,
        views=shown,
        published=published,
        aggregate=summaries.aggregate_curves(learned),
        table=summaries.summary_table(learned, published, request.window),
        findings=findings,
        by_hand=leaderboard.by_hand(reported, request.task),
        runs=_runs(reported),
        paths={(s.name, run): paths for s in reported for run, paths in s.paths.items()},
        notes=notes,
        problems=[problem for source in reported for problem in source.problems],
    )


def _runs(reported: Sequence[Source]) -> pd.DataFrame:
    """Returns the runs of all sources, with a column `source` if there are several."""
    if len(reported) == 1:
        return reported[0].runs
    return pd.concat([s.runs.assign(source=s.name) for s in reported], ignore_index=True)


def _findings(
    shown: Sequence[views.View],
    published: Sequence[PublishedCurve],
    own: Source,
    request: Request,
) -> tuple[list[claims.Finding] | None, list[str]]:
    """Returns findings in the order of the claims, if requested, and notes on untested ones."""
    if not request.claims:
        return None, []
    by_hand, notes = heuristics.findings(own.tables, request.task)
    curves = [
        curve
        for curve in published
        if request.task in (None, curve.task) and request.algo in (None, curve.algo)
    ]
    ours = [finding for view in shown for finding in view.findings]
    findings = [*ours, *by_hand, *published_claims.examine_published(curves)]
    return sorted(findings, key=lambda finding: finding.claim), notes


def _data_files(data: ReportData) -> dict[str, bytes]:
    """Returns the files with the exact numbers of figures and tables."""
    frames = {"aggregate": data.aggregate, "table": data.table}
    statistics = [one for view in data.views for one in view.statistics]
    if statistics:
        frames["seed_statistics"] = scores.statistics_frame(statistics)
    if data.comparisons:
        frames["seed_comparisons"] = comparisons.comparisons_frame(data.comparisons)
    groups = [group for view in data.views for group in view.groups]
    if groups:
        frames["reduction"] = reduction.frame(groups)
    if data.findings is not None:
        frames["findings"] = claims.findings_frame(data.findings)
    if not data.encoders.empty:
        frames["encoders"] = data.encoders
    files = {f"{name}.csv": _to_csv(frame) for name, frame in frames.items()}
    return {"aggregate.parquet": _to_parquet(data.aggregate), **files}


def _table_files(document: Document) -> dict[str, bytes]:
    return {
        f"{item.name}.{ending}": make(item).encode()
        for item in contents.tables(document)
        for ending, make in files.FORMATS.items()
    }


def _figure_files(item: FigureItem, request: Request) -> dict[str, bytes]:
    sheet = SHEETS[request.columns]
    drawn = plotting.draw(item.figure, sheet)
    return {
        f"{item.name}.{ending}": plotting.FORMATS[ending](drawn, paper=sheet.paper)
        for ending in request.formats
    }


def _page(document: Document, request: Request) -> dict[str, bytes]:
    html = page.render_document(document, sheet=SHEETS[request.columns], reloads=request.watched)
    return {"index.html": html.encode()}


def _to_csv(frame: pd.DataFrame) -> bytes:
    """Returns the rows as CSV with a header, by pyarrow, which is ten times as fast as pandas."""
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(frame.columns)
    sink = io.BytesIO()
    sink.write(header.getvalue().encode())
    rows = pa.Table.from_pandas(frame, preserve_index=False, nthreads=1)
    write_csv(rows, sink, WriteOptions(include_header=False, quoting_style="needed"))
    return sink.getvalue()


def _to_parquet(frame: pd.DataFrame) -> bytes:
    sink = io.BytesIO()
    rows = pa.Table.from_pandas(frame, preserve_index=False, nthreads=1)
    pq.write_table(rows, sink, compression="zstd")
    return sink.getvalue()
