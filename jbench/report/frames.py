"""The frames of a report: a tidy table for each of its figures and tables.

A figure, its tooltips, a table of the page, its CSV, LaTeX and Markdown are functions of a frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import pandas as pd

from jbench.errors import RequestError
from jbench.names import ReturnsName
from jbench.report import policies
from jbench.report.analysis import comparisons, examine, published_claims
from jbench.report.compared import (
    claim_frame,
    comparison_frame,
    pair_frame,
    profile_frame,
    verdict_frame,
)
from jbench.report.configurations import (
    configuration_frame,
    curve_frame,
    processor_frame,
    published_frame,
    run_curve_frame,
    seed_frame,
    sequence_frame,
)
from jbench.report.data import rows as sources
from jbench.report.data.cells import IMPORTED, Cell, of_kind, verified
from jbench.report.data.published import (
    PublishedCurve,
    imported_curve,
    read_published,
    read_sequences,
)
from jbench.report.data.returns import KINDS, TRAINING
from jbench.report.data.rows import Rows
from jbench.report.encoders import encoder_frame, prediction_frame
from jbench.report.headline import headline
from jbench.report.leaderboard import leaderboard
from jbench.report.request import Request
from jbench.report.runs import provenance_frame, run_frame
from jbench.store import Results, query
from jbench.store.shipped import shipped_results

_DEFAULT = Request()


@dataclass
class Frames:
    """All that a report shows.

    Attributes:
        returns: kind of return that is shown first; also that of pairs, profiles, predictions.
        notes: sentences for the reader.
        problems: a sentence for each unreadable record.
    """

    request: Request
    returns: ReturnsName
    headline: str
    notes: list[str]
    problems: list[str]
    configurations: pd.DataFrame
    curves: pd.DataFrame
    published: pd.DataFrame
    seeds: pd.DataFrame
    run_curves: pd.DataFrame
    paths: pd.DataFrame
    baselines: pd.DataFrame
    verdicts: pd.DataFrame
    pairs: pd.DataFrame
    profiles: pd.DataFrame
    encoders: pd.DataFrame
    predictions: pd.DataFrame
    processor: pd.DataFrame
    motor: pd.DataFrame
    positions: pd.DataFrame
    sequences: pd.DataFrame
    comparisons: pd.DataFrame
    claims: pd.DataFrame
    runs: pd.DataFrame
    leaderboard: pd.DataFrame
    provenance: pd.DataFrame = field(init=False)

    def __post_init__(self) -> None:
        """Adds what the runs have recorded."""
        self.provenance = provenance_frame(self.runs)


def frames(results: Results, request: Request = _DEFAULT) -> Frames:
    """Returns the frames of the report on some results.

    Raises:
        NothingYetError: if there are no runs, or none passes the filters.
        WorkError: if there are runs but none can be read.
    """
    parts, notes = _read(results, request)
    rows = sources.joined(parts)
    table = query.published()
    published, augmented = read_published(table), read_sequences(table)
    curves = [(cell, cell.curve(request.order, request.window)) for cell in rows.cells]
    baselines = [
        imported_curve(cell, curve)
        for cell, curve in curves
        if (cell.source, cell.algo) == (IMPORTED, request.baseline)
    ]
    drawn = [
        (cell, curve)
        for cell, curve in curves
        if (cell.source, cell.algo) != (IMPORTED, request.baseline)
    ]
    plain = [pair for pair in drawn if pair[0].robots <= 1]
    returns = _leading(rows.cells, request)
    lead = of_kind(rows.cells, KINDS[returns])
    configurations = configuration_frame(curves, [*published, *augmented])
    leading = configurations[configurations["returns"] == returns]
    verdicts = verdict_frame(verified(rows.cells))
    encoders = encoder_frame(rows.tables, request.task)
    motor, positions, unread = policies.behavior(results, request.task)
    claims, untested = _claims(rows, published, request)
    runs = run_frame(rows, returns)
    return Frames(
        request=request,
        returns=returns,
        headline=headline(verdicts[verdicts["returns"] == returns], leading),
        notes=[*rows.notes, *notes, *_cell_notes(rows.cells), *untested],
        problems=[*rows.problems, *unread],
        configurations=configurations,
        curves=curve_frame(plain),
        published=published_frame([*published, *baselines], rows.cells, request.algo),
        seeds=seed_frame(rows.cells),
        run_curves=run_curve_frame(plain),
        paths=rows.paths,
        baselines=policies.baseline_frame({cell.task for cell in rows.cells}),
        verdicts=verdicts,
        pairs=pair_frame(lead),
        profiles=profile_frame(lead),
        encoders=encoders,
        predictions=prediction_frame(verified(lead), encoders),
        processor=processor_frame([pair for pair in plain if pair[0].kind is KINDS[returns]]),
        motor=motor,
        positions=positions,
        sequences=sequence_frame([pair for pair in drawn if pair[0].robots > 1], augmented),
        comparisons=_comparisons(parts, request),
        claims=claims,
        runs=runs,
        leaderboard=leaderboard(
            leading, policies.hand_written_returns(rows.tables), published, request.algo
        ),
    )


def _read(results: Results, request: Request) -> tuple[list[Rows], list[str]]:
    """Returns the rows of each source, and notes."""
    if request.compare is not None:
        sides = [sources.side(text, results, request) for text in request.compare]
        return sides, _check_comparable(sides[0], sides[1], request)
    parts = sources.own_and_imported(results, request)
    if request.reference:
        parts.append(sources.reference(request, shipped_results()))
    cells = [cell for part in parts for cell in part.cells]
    if request.baseline is not None:
        sources.check_baseline(request.baseline, cells)
    encoders = encoder_frame(parts[0].tables, request.task)
    drawable = cells or len(encoders) or _has_states(results, request.task)
    if parts[0].runs.empty and not drawable:
        raise sources.nothing_to_report(results, [p for part in parts for p in part.problems])
    if not drawable:
        raise sources.NothingYetError(
            f"No run has an episode yet; wait for them. {' '.join(parts[0].notes)}"
        )
    return parts, []


def _has_states(results: Results, task: str | None) -> bool:
    """Returns whether states of policies were saved, which can be drawn without any run."""
    saved = (one.settings for one in results.scan("evaluation")[0])
    return any(one.get("states") and task in (None, one.get("task")) for one in saved)


def _check_comparable(one: Rows, other: Rows, request: Request) -> list[str]:
    """Returns notes on configurations of two sides without a counterpart on the other.

    Raises:
        RequestError: if none has a counterpart.
    """
    names = request.names_compared
    ours, theirs = (of_kind(rows.cells, TRAINING) for rows in (one, other))
    pairs = comparisons.across(ours, theirs, names)
    notes = comparisons.near_misses(ours, theirs, pairs)
    if not pairs:
        free = ", ".join([*sorted(names), "seeds and steps"])
        raise RequestError(
            f"No runs of {' and '.join(request.compare or ())} can be compared: there must be "
            f"runs of both that differ only in {free}. {notes[0] if notes else ''}".strip()
        )
    return [*(note for cells in (ours, theirs) for note in comparisons.alone(cells, pairs)), *notes]


def _leading(cells: Sequence[Cell], request: Request) -> ReturnsName:
    """Returns the requested kind of return, or the other one if no run has it."""
    kinds = {cell.kind.name for cell in cells}
    return request.returns if request.returns in kinds or not kinds else kinds.pop()


def _comparisons(parts: Sequence[Rows], request: Request) -> pd.DataFrame:
    """Returns the comparisons of the two sides of the request, for both kinds of return."""
    if request.compare is None:
        return comparison_frame([])
    found = [
        comparisons.compare(one, other)
        for kind in KINDS.values()
        for one, other in comparisons.across(
            of_kind(parts[0].cells, kind), of_kind(parts[1].cells, kind), request.names_compared
        )
    ]
    return comparison_frame(found)


def _claims(
    rows: Rows, published: Sequence[PublishedCurve], request: Request
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the findings on the claims, if requested, and notes on untested ones."""
    if not request.claims:
        return claim_frame([]), []
    cells = verified(rows.cells)
    tested = [one for kind in KINDS.values() for one in examine.examine(of_kind(cells, kind))]
    by_hand, notes = policies.findings(rows.tables, request.task)
    curves = [
        curve
        for curve in published
        if request.task in (None, curve.task) and request.algo in (None, curve.algo)
    ]
    found = [*tested, *by_hand, *published_claims.examine_published(curves)]
    return claim_frame(sorted(found, key=lambda one: one.claim)), notes


def _cell_notes(cells: Sequence[Cell]) -> list[str]:
    """Returns the notes on configurations, a sentence each; equal notes are one sentence."""
    named: dict[str, list[str]] = {}
    for cell in cells:
        for note in cell.notes:
            named.setdefault(note, []).append(cell.configuration)
    return [
        f"{names[0] if len(names) == 1 else f'{len(names)} configurations, such as {names[0]}'}: "
        f"{note}."
        for note, names in named.items()
    ]
