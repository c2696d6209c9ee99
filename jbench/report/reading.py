"""What a report reads: the runs that were asked for, their pairs, claims and notes."""

from collections.abc import Sequence

import pandas as pd

from jbench.errors import NothingYetError, RequestError, WorkError
from jbench.names import RETURNS, is_reference
from jbench.report import policies
from jbench.report.analysis import compare
from jbench.report.analysis.claim_frame import claim_frame, published_findings
from jbench.report.analysis.claims import examine
from jbench.report.analysis.decisions import Study
from jbench.report.analysis.findings import Finding
from jbench.report.analysis.pair import Pair
from jbench.report.analysis.schedules import nothing_in_common
from jbench.report.data import sources
from jbench.report.data.configuration import Configuration, with_returns
from jbench.report.data.sources import Source
from jbench.report.encoders import encoder_frame
from jbench.report.request import Request, is_directory
from jbench.report.sides import named_sides
from jbench.returns import TRAINING
from jbench.settings.algorithms import display_name
from jbench.settings.run import RunSettings
from jbench.settings.variants import hyperparameter_words
from jbench.store import Record, Results
from jbench.store.shipped import shipped_results
from jbench.wording import in_prose, repair_hint, with_results

_USUAL_TASK = "face_direction"
"""The task of the Jitterbug that most pages begin with."""

Pairs = list[list[Pair]]


def read(results: Results | None, request: Request) -> tuple[Source, Pairs]:
    """Returns the runs of a request, and the pairs that it compares.

    Raises:
        NothingYetError: if there are no runs, or no run has an episode.
        RequestError: if a file can't be read, two sides have nothing to compare, or the shipped
            runs are to be added to themselves.
        WorkError: if there are runs but none can be read.
    """
    if request.curves is not None:
        source = sources.from_file(request, request.curves)
        return source, compare.method_pairs(source.configurations)

    assert results is not None
    if request.compare is not None:
        first, second, _ = named_sides(request.compare)
        ours = sources.side(request.compare[0], first, results, request)
        theirs = sources.side(request.compare[1], second, results, request)
        source, pairs = _compared(ours, theirs, request)
        _note_shared(source)
        return source, pairs

    if request.reference and is_reference(results.path):  # each of its runs would count twice
        raise RequestError("--reference adds the runs that --results reference has; leave it out.")

    source = own = sources.own_and_imported(results, request)
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
        _note_shared(source)
        return source, []

    if len(own.runs):
        raise NothingYetError(f"No run has an episode yet; wait for them. {' '.join(own.notes)}")
    if source.problems or any(results.scan("run")):
        reason = " ".join([*source.problems, repair_hint(results.name)])
        raise WorkError(f"Nothing in {results.name} can be reported. {reason}")

    train = with_results(_training_command(request, results), results.name)
    raise NothingYetError(f"There are no runs in {results.name}; run `{train}` first.")


def _training_command(request: Request, results: Results) -> str:
    """Returns the command of a small training of what was asked for.

    Without a task, it is of the robot that the newest dataset or evaluation is of.
    """
    task = request.task
    if task is None:
        records = [*results.scan("dataset")[0], *results.scan("evaluation")[0]]
        newest = max(records, key=lambda record: record.manifest.updated, default=None)
        task = _USUAL_TASK if newest is None else _recorded_task(newest)

    command = f"jbench train --task {task}"
    if request.algo:
        command += f" --algo {request.algo[0]}"
    return f"{command} --steps 100000 --seeds 0-1"


def _recorded_task(record: Record) -> str:
    """Returns the task of an evaluation, or one of the robot of a dataset."""
    from jbench.datasets.by_robot import recorded_layout  # it imports simulators

    task = record.settings.get("task")
    return recorded_layout(record).task if task is None else str(task)


def _note_shared(source: Source) -> None:
    """Notes once the hyperparameters that all trained runs share, in place of every name."""
    trained = [c for c in source.configurations if isinstance(c.settings, RunSettings)]
    if not trained:
        return

    shared = [
        word
        for word in hyperparameter_words(trained[0].settings)
        if all(word in config.each_word for config in trained)
    ]
    for config in trained:
        config.set_words([word for word in config.each_word if word not in shared])

    if not shared:
        return

    whose = "All runs"
    if len(trained) < len(source.configurations):
        # Recorded and imported runs have other settings, or none.
        algorithms = dict.fromkeys(display_name(config.algo) for config in trained)
        whose += f" of {in_prose(algorithms, 'and')}"

    source.shared = f"{whose}: {', '.join(shared)}"
    source.notes.insert(0, f"{source.shared}, not the defaults.")


def _compared(ours: Source, theirs: Source, request: Request) -> tuple[Source, Pairs]:
    """Returns two sides together, with notes on what has no counterpart, and their pairs."""
    names = request.names_compared
    pairs = compare.across(ours.configurations, theirs.configurations, names)
    first, other = (with_returns(side.configurations, TRAINING) for side in (ours, theirs))
    notes = compare.left_out(first, other, pairs)
    sides = " and ".join(request.compare or ())
    if not pairs:
        free = ", ".join([*sorted(names), "seeds and steps"])
        why = [note for note in notes if "is not compared" in note][:1]
        raise RequestError(
            f"No runs of {sides} can be compared: there must be runs of both that differ only in "
            f"{free}. {''.join(why)}".strip()
        )

    apart = [nothing_in_common(pair) for pair in pairs]
    if all(apart):
        raise RequestError(f"No runs of {sides} can be compared: {apart[0]}.")

    if not any(map(is_directory, request.compare or ())):
        _leave_out_sides(ours, theirs)

    source = sources.joined([ours, theirs])
    source.notes += notes
    return source, [[pair] for pair in pairs]


def _leave_out_sides(ours: Source, theirs: Source) -> None:
    """Leaves out the sides of names that tell the configurations of both apart without them."""
    names = [{config.name for config in side.configurations} for side in (ours, theirs)]
    if names[0].isdisjoint(names[1]):
        for config in (*ours.configurations, *theirs.configurations):
            config.is_named_by_source = False
            config.set_words(config.each_word)


def tested_claims(
    trained: Sequence[Configuration],
    studies: Sequence[Study],
    source: Source,
    request: Request,
    results: Results | None,
) -> tuple[pd.DataFrame, list[str]]:
    """Returns the findings on the paper's claims, and what to type for those not tested."""
    if results is None or not request.claims:
        return claim_frame(), []

    ours: list[Finding] = []
    for kind in RETURNS:
        ours += examine(with_returns(trained, kind), studies)

    by_hand, notes = policies.findings(source.tables, request.task, results.name)
    papers = published_findings(request.task, request.algo)
    # Two sides are compared without their policies.
    return claim_frame([*ours, *by_hand], papers), [] if request.compare else notes


def notes_on(configurations: Sequence[Configuration]) -> list[str]:
    """Returns the notes on configurations, a sentence each; equal notes are one sentence."""
    named: dict[str, list[str]] = {}
    for config in configurations:
        for note in config.notes:
            names = named.setdefault(note, [])
            # A configuration has a part for each kind of return.
            if config.configuration not in names:
                names.append(config.configuration)

    return [
        f"{names[0] if len(names) == 1 else f'{len(names)} configurations, such as {names[0]}'}: "
        f"{note}."
        for note, names in named.items()
    ]
