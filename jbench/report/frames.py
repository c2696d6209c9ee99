"""The frames of a report: a tidy table for each of its figures and tables.

A figure, its tooltips, a table of the page, its CSV, LaTeX and Markdown are functions of a frame.
"""

from collections.abc import Sequence

import pandas as pd

from jbench.errors import NothingYetError, RequestError, WorkError
from jbench.report import configurations, policies
from jbench.report.analysis import compare, scores
from jbench.report.analysis.claims import claim_frame, examine, published_findings
from jbench.report.analysis.decisions import Planned, decision_frame, planned_comparisons
from jbench.report.analysis.verdicts import verdict_frame
from jbench.report.data import sources
from jbench.report.data.configuration import IMPORTED, Configuration, with_returns
from jbench.report.data.curves import SEQUENCE, read_published
from jbench.report.data.returns import FILE, KINDS, TRAINING, clean, map_texts
from jbench.report.data.sources import Source
from jbench.report.encoders import encoder_frame, prediction_frame
from jbench.report.headline import headline
from jbench.report.leaderboard import leaderboard
from jbench.report.request import Request
from jbench.report.runs import provenance_frame, run_frame
from jbench.store import Results, query
from jbench.store.shipped import shipped_results
from jbench.wording import repair_hint, with_results

Pairs = list[list[scores.Pair]]
DEFAULT = Request()  # a report of all runs


class Frames:
    """All that a report on some results shows, or on the file of a request.

    `returns` is the kind of return that is shown first, and that of pairs, profiles, predictions.
    `interpolated` says whether seeds of a curve were logged at different control steps.
    Notes are sentences for the reader; problems are those on unreadable records.
    """

    def __init__(self, results: Results | None, request: Request = DEFAULT) -> None:
        """Reads the results; a NothingYetError without runs, a WorkError if none can be read."""
        source, compared = _read(results, request)
        every = source.configurations
        kinds = {config.kind for config in every}
        returns = request.returns if request.returns in kinds or not kinds else kinds.pop()
        curves = [(c, c.curve(request.order, request.window)) for c in every]
        apart = {c for c in every if (c.source, c.algo) == (IMPORTED, request.baseline)}
        drawn = [pair for pair in curves if pair[0] not in apart]
        plain = [pair for pair in drawn if pair[0].robots <= 1]
        trained = [config for config in every if config.source != IMPORTED]
        lead, trained_lead = with_returns(every, returns), with_returns(trained, returns)
        published = read_published(query.published())
        figures = published[published["figure"] != SEQUENCE]
        known = {config.task for config in every if config.source != FILE}
        self.request, self.returns = request, returns
        self.configurations = configurations.configuration_frame(curves, published)
        leading = self.configurations[self.configurations["returns"] == returns]
        planned = planned_comparisons(trained)
        self.decisions = decision_frame(planned)
        self.verdicts = verdict_frame(trained, self.decisions, planned)
        self.comparisons = compare.comparison_frame(compared)
        self.headline = headline(self.lead(self.verdicts), leading, self.lead(self.comparisons))
        self.configurations = scores.with_file_means(self.configurations, lead)
        self.curves = configurations.curve_frame(plain)
        beside = [pair for pair in curves if pair[0] in apart]
        self.published = configurations.published_frame(figures, known, request.algo, beside)
        self.seeds = configurations.seed_frame(every)
        self.run_curves = configurations.run_curve_frame(plain)
        self.interpolated = any(config.common.interpolated for config, _ in plain)
        self.metrics, self.paths = source.tables["metrics"], source.paths
        self.baselines = policies.baseline_frame(known)
        self.pairs = compare.pair_frame(trained_lead, self.lead(self.verdicts))
        self.profiles = scores.profile_frame(lead)
        self.encoders = encoder_frame(source.tables, request.task)
        self.predictions = prediction_frame(trained_lead, self.encoders)
        self.processor = self.lead(configurations.processor_frame(plain))
        self.motor, self.positions, unread = policies.behavior(results, request.task)
        sequences = [pair for pair in drawn if pair[0].robots > 1]
        theirs = published[published["figure"] == SEQUENCE]
        self.sequences = configurations.sequence_frame(sequences, theirs)
        self.claims, untested = _claims(trained, planned, source, request, results)
        self.runs = run_frame(source, returns)
        self.provenance = provenance_frame(self.runs)
        by_hand = policies.hand_written_returns(source.tables)
        ranked = leading[leading["source"] != FILE]
        self.leaderboard = leaderboard(ranked, by_hand, figures, request.algo)
        self.notes = [*source.notes, *_notes(every), *untested]
        self.problems = [*source.problems, *unread]
        self.clean()

    def clean(self) -> None:
        """Brings each text into one line, without control characters."""
        self.headline = clean(self.headline)
        for name, value in vars(self).items():
            if isinstance(value, list):
                setattr(self, name, list(map(clean, value)))
            elif isinstance(value, pd.DataFrame):
                setattr(self, name, map_texts(value))

    def lead(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns the rows of a frame that are of the kind of return that is shown first."""
        return frame[frame["returns"] == self.returns]


def _read(results: Results | None, request: Request) -> tuple[Source, Pairs]:
    if request.curves is not None:
        source = sources.from_file(request, request.curves)
        return source, compare.method_pairs(source.configurations)
    assert results is not None
    if request.compare is not None:
        ours, theirs = (sources.side(side, results, request) for side in request.compare)
        return _compared(ours, theirs, request)
    source = read = sources.own_and_imported(results, request)
    if request.reference:
        source = sources.joined([source, sources.reference(request, shipped_results())])
    if request.baseline is not None:
        sources.check_baseline(request.baseline, source.configurations)
    saved = (record.settings for record in results.scan("evaluation")[0])
    if (
        source.configurations
        or len(encoder_frame(source.tables, request.task))
        # States of policies can be drawn without any run.
        or any(s.get("states") and request.task in (None, s.get("task")) for s in saved)
    ):
        return source, []
    if len(read.runs):
        raise NothingYetError(f"No run has an episode yet; wait for them. {' '.join(read.notes)}")
    if source.problems or any(results.scan("run")):
        reason = " ".join([*source.problems, repair_hint(results.name)])
        raise WorkError(f"Nothing in {results.name} can be reported. {reason}")
    train = "jbench train --task face_direction --steps 100000 --seeds 0-1"
    raise NothingYetError(
        f"There are no runs in {results.name}; run `{with_results(train, results.name)}` first."
    )


def _compared(ours: Source, theirs: Source, request: Request) -> tuple[Source, Pairs]:
    """Returns two sides together, with notes on what has no counterpart, and their pairs."""
    names = request.names_compared
    pairs = compare.across(ours.configurations, theirs.configurations, names)
    first, other = (with_returns(side.configurations, TRAINING) for side in (ours, theirs))
    notes = compare.left_out(first, other, pairs)
    if not pairs:
        free = ", ".join([*sorted(names), "seeds and steps"])
        why = [note for note in notes if "is not compared" in note][:1]
        sides = " and ".join(request.compare or ())
        raise RequestError(
            f"No runs of {sides} can be compared: there must be runs of both that differ only in "
            f"{free}. {''.join(why)}".strip()
        )
    source = sources.joined([ours, theirs])
    source.notes += notes
    return source, [[pair] for pair in pairs]


def _claims(
    trained: Sequence[Configuration],
    planned: Sequence[Sequence[Planned]],
    source: Source,
    request: Request,
    results: Results | None,
) -> tuple[pd.DataFrame, list[str]]:
    if results is None or not request.claims:
        return claim_frame(), []
    ours = [finding for kind in KINDS for finding in examine(with_returns(trained, kind), planned)]
    by_hand, notes = policies.findings(source.tables, request.task, results.name)
    papers = published_findings(request.task, request.algo)
    # Two sides are compared without their policies.
    return claim_frame([*ours, *by_hand], papers), [] if request.compare else notes


def _notes(configurations: Sequence[Configuration]) -> list[str]:
    """Returns the notes on configurations, a sentence each; equal notes are one sentence."""
    named: dict[str, list[str]] = {}
    for config in configurations:
        for note in config.notes:
            named.setdefault(note, []).append(config.configuration)
    return [
        f"{names[0] if len(names) == 1 else f'{len(names)} configurations, such as {names[0]}'}: "
        f"{note}."
        for note, names in named.items()
    ]
