"""The frames of a report: a tidy table for each of its figures and tables.

A figure, its tooltips, a table of the page, its CSV, LaTeX and Markdown are functions of a frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import pandas as pd

from jbench.errors import NothingYetError, RequestError, WorkError
from jbench.names import ReturnsName
from jbench.report import policies
from jbench.report.analysis import compare, tasks
from jbench.report.analysis.claims import claim_frame
from jbench.report.analysis.examine import examine, examine_published
from jbench.report.analysis.scores import Pair
from jbench.report.analysis.verdicts import decision_frame, verdict_frame
from jbench.report.configurations import (
    configuration_frame,
    curve_frame,
    processor_frame,
    published_frame,
    run_curve_frame,
    seed_frame,
    sequence_frame,
)
from jbench.report.data import sources
from jbench.report.data.configuration import IMPORTED, Configuration, verified, with_returns
from jbench.report.data.published import SEQUENCE, imported_curve, read_published
from jbench.report.data.returns import FILE, KINDS, TRAINING
from jbench.report.data.sources import Source
from jbench.report.encoders import encoder_frame, prediction_frame
from jbench.report.headline import headline
from jbench.report.leaderboard import leaderboard
from jbench.report.request import Request
from jbench.report.runs import metric_frame, provenance_frame, run_frame
from jbench.store import Results, query
from jbench.store.shipped import shipped_results
from jbench.wording import repair_hint, with_results

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
    metrics: pd.DataFrame
    paths: pd.DataFrame
    baselines: pd.DataFrame
    verdicts: pd.DataFrame
    decisions: pd.DataFrame
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


def frames(results: Results | None, request: Request = _DEFAULT) -> Frames:
    """Returns the frames of the report on some results, or on the file of the request.

    Raises:
        NothingYetError: if there are no runs, or none passes the filters.
        WorkError: if there are runs but none can be read.
    """
    parts, groups, notes = _read(results, request)
    source = sources.joined(parts)
    every = source.configurations
    published = read_published(query.published())
    curves = [(one, one.curve(request.order, request.window)) for one in every]
    baseline = IMPORTED, request.baseline
    baselines = [imported_curve(*pair) for pair in curves if _named(pair[0]) == baseline]
    drawn = [pair for pair in curves if _named(pair[0]) != baseline]
    plain = [pair for pair in drawn if pair[0].robots <= 1]
    returns = _leading(every, request)
    lead = with_returns(every, returns)
    configurations = configuration_frame(curves, published)
    leading = configurations[configurations["returns"] == returns]
    decisions = decision_frame(verified(every))
    verdicts = verdict_frame(verified(every), decisions)
    comparisons = compare.comparison_frame(groups)
    encoders = encoder_frame(source.tables, request.task)
    motor, positions, unread = policies.behavior(results, request.task)
    claims, untested = _claims(source, published, request)
    known = {one.task for one in every if one.source != FILE}
    figures = published[published["figure"] != SEQUENCE]
    return Frames(
        request=request,
        returns=returns,
        headline=headline(
            verdicts[verdicts["returns"] == returns],
            leading,
            comparisons[comparisons["returns"] == returns],
        ),
        notes=[*source.notes, *notes, *_notes(every), *untested],
        problems=[*source.problems, *unread],
        configurations=tasks.with_file_means(configurations, lead),
        curves=curve_frame(plain),
        published=published_frame(pd.concat([figures, *baselines]), known, request.algo),
        seeds=seed_frame(every),
        run_curves=run_curve_frame(plain),
        metrics=metric_frame(source),
        paths=source.paths,
        baselines=policies.baseline_frame(known),
        verdicts=verdicts,
        decisions=decisions,
        pairs=compare.pair_frame(lead, verdicts[verdicts["returns"] == returns]),
        profiles=tasks.profile_frame(lead),
        encoders=encoders,
        predictions=prediction_frame(verified(lead), encoders),
        processor=processor_frame([pair for pair in plain if pair[0].kind == returns]),
        motor=motor,
        positions=positions,
        sequences=sequence_frame(
            [pair for pair in drawn if pair[0].robots > 1],
            published[published["figure"] == SEQUENCE],
        ),
        comparisons=comparisons,
        claims=claims,
        runs=run_frame(source, returns),
        leaderboard=leaderboard(
            leading[leading["source"] != FILE],
            policies.hand_written_returns(source.tables),
            figures,
            request.algo,
        ),
    )


def _named(configuration: Configuration) -> tuple[str, str]:
    return configuration.source, configuration.algo


def _read(
    results: Results | None, request: Request
) -> tuple[list[Source], list[list[Pair]], list[str]]:
    """Returns each source, the pairs of compared configurations, and notes."""
    if request.curves is not None:
        part = sources.from_file(request, request.curves)
        return [part], compare.method_pairs(part.configurations), []
    assert results is not None
    if request.compare is not None:
        sides = [sources.side(text, results, request) for text in request.compare]
        return sides, *_compared(sides[0].configurations, sides[1].configurations, request)
    parts = sources.own_and_imported(results, request)
    if request.reference:
        parts.append(sources.reference(request, shipped_results()))
    configurations = [one for part in parts for one in part.configurations]
    if request.baseline is not None:
        sources.check_baseline(request.baseline, configurations)
    drawable = (
        configurations
        or len(encoder_frame(parts[0].tables, request.task))
        or _has_states(results, request.task)
    )
    if parts[0].runs.empty and not drawable:
        raise _nothing_to_report(results, [p for part in parts for p in part.problems])
    if not drawable:
        raise NothingYetError(
            f"No run has an episode yet; wait for them. {' '.join(parts[0].notes)}"
        )
    return parts, [], []


def _nothing_to_report(results: Results, problems: Sequence[str]) -> RequestError | WorkError:
    """Returns the error for results without usable runs."""
    records, unreadable = results.scan("run")
    if records or unreadable or problems:
        reason = " ".join([*problems, repair_hint(results.name)])
        return WorkError(f"Nothing in {results.name} can be reported. {reason}")
    train = "jbench train --task face_direction --steps 100000 --seeds 0-1"
    return NothingYetError(
        f"There are no runs in {results.name}; run `{with_results(train, results.name)}` first."
    )


def _has_states(results: Results, task: str | None) -> bool:
    """Returns whether states of policies were saved, which can be drawn without any run."""
    saved = (one.settings for one in results.scan("evaluation")[0])
    return any(one.get("states") and task in (None, one.get("task")) for one in saved)


def _compared(
    ours: Sequence[Configuration], theirs: Sequence[Configuration], request: Request
) -> tuple[list[list[Pair]], list[str]]:
    """Returns the pairs of two sides, and notes on configurations without a counterpart.

    Raises:
        RequestError: if none has a counterpart.
    """
    names = request.names_compared
    pairs = compare.across(ours, theirs, names)
    notes = compare.left_out(with_returns(ours, TRAINING), with_returns(theirs, TRAINING), pairs)
    if not pairs:
        free = ", ".join([*sorted(names), "seeds and steps"])
        why = [note for note in notes if "is not compared" in note][:1]
        sides = " and ".join(request.compare or ())
        raise RequestError(
            f"No runs of {sides} can be compared: there must be runs of both that differ only in "
            f"{free}. {''.join(why)}".strip()
        )
    return [[pair] for pair in pairs], notes


def _leading(configurations: Sequence[Configuration], request: Request) -> ReturnsName:
    """Returns the requested kind of return, or the other one if no run has it."""
    kinds = {one.kind for one in configurations}
    return request.returns if request.returns in kinds or not kinds else kinds.pop()


def _claims(
    source: Source, published: pd.DataFrame, request: Request
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the findings on the claims, if requested, and notes on untested ones."""
    if not request.claims:
        return claim_frame([]), []
    runs = verified(source.configurations)
    found = [finding for kind in KINDS for finding in examine(with_returns(runs, kind))]
    by_hand, notes = policies.findings(source.tables, request.task)
    for name in ("task", "algo"):
        if (value := getattr(request, name)) is not None:
            published = published[published[name] == value]
    return claim_frame([*found, *by_hand, *examine_published(published)]), notes


def _notes(configurations: Sequence[Configuration]) -> list[str]:
    """Returns the notes on configurations, a sentence each; equal notes are one sentence."""
    named: dict[str, list[str]] = {}
    for one in configurations:
        for note in one.notes:
            named.setdefault(note, []).append(one.configuration)
    return [
        f"{names[0] if len(names) == 1 else f'{len(names)} configurations, such as {names[0]}'}: "
        f"{note}."
        for note, names in named.items()
    ]
