"""Commands that check results: verify, reproduce."""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Argument, Option

from jbench.commands import options, output, parsing
from jbench.cores import ONE_THREAD
from jbench.errors import RequestError, WorkError
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    from jbench.store import Record, Results
    from jbench.store.verify import Verified
    from jbench.training.present import OtherCode
    from jbench.training.repeated_rows import Repeated


def verify(
    threads: int = options.FILES,
    reevaluate: bool = Option(
        False, "--reevaluate", help="Also repeat each run's last evaluation with its kept policy."
    ),
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE_TO_REEVALUATE,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Check every manifest, row count and checksum.

    Files that no manifest lists are reported as well.
    """
    if accept_changed_code and not reevaluate:
        raise RequestError("--accept-changed-code is for --reevaluate; type both, or neither.")
    if reevaluate:
        os.environ.update(ONE_THREAD)  # as in training, before libraries are imported

    from jbench.store.verify import verify as check

    database = parsing.results_to_read(results)
    checked = check(database, threads, partial(output.progress, "verify", unit="folders"))
    _show_checked(checked, results)
    others = _show_other_code(database)
    repeated = _reevaluate_all(database, accept_changed_code) if reevaluate else []
    document = checked._asdict() | {"findings": [flaw._asdict() for flaw in checked.findings]}
    document["other_code"] = [record._asdict() for record in others]
    if reevaluate:
        document["reevaluations"] = [part._asdict() for part in repeated]

    output.document(document)
    if any(fault.sort != "foreign" for fault in checked.faults):
        raise WorkError(
            f"Some results are damaged or left over; {with_results('jbench repair', results)} sets "
            "them aside. Intact results can still be used."
        )

    if checked.faults:
        raise WorkError("Some results can't be checked; see above. The others can still be used.")

    compared = [part for part in repeated if part.control_steps is not None]
    if different := sum(part.verdict == "different" for part in compared):
        count = f"{different} of {len(compared)} repeated runs"
        raise WorkError(f"{count} have other returns than recorded; see above.")
    if reevaluate and not compared:
        raise WorkError("No run could be compared with its last evaluation.")


def _show_checked(checked: "Verified", results: Path) -> None:
    """Prints the flaws of records, and how much was checked."""
    from jbench.store.shipped import LEFT_OUT

    for (kind, id), flaws in groupby(checked.findings, lambda flaw: (flaw.kind, flaw.id)):
        output.say(f"{kind} {id}")
        for flaw in flaws:
            output.say(f"  {'Warning: ' if flaw.sort == 'warning' else ''}{flaw}")

    if not (checked.records or checked.findings):
        output.say(f"There are no records in {results}, so nothing was checked.")
    else:
        output.say(
            f"Checked {counted(checked.records, 'record')}, {counted(checked.files, 'file')}, "
            f"{checked.bytes / 1e6:,.1f} MB: "
            f"{output.tally(flaw.sort for flaw in checked.findings) or 'all of them intact'}."
        )

    if checked.left_out:
        count = counted(checked.left_out, "run")
        output.say(f"Not checked: the policy of {count}, which {LEFT_OUT}.")


def _show_other_code(database: "Results") -> list["OtherCode"]:
    """Prints the records whose users' code is not the present one, or not at hand."""
    from jbench.store.code import have_changed, short_date
    from jbench.store.manifest import KINDS
    from jbench.training.present import other_code

    records = [record for kind in KINDS for record in database.scan(kind)[0]]
    others = list(other_code(records))
    for other in others:
        what = (
            f"{have_changed(other.files)} since then" if other.files else "its code is not at hand"
        )
        output.say(f"{other.kind} {other.id}, of {short_date(other.created)}: {what}.")

    by_state = {
        "has changed": [other for other in others if other.files],
        "is not at hand": [other for other in others if not other.files],
    }
    states = [
        f"that of {counted(len(records), 'record')} {state}"
        for state, records in by_state.items()
        if records
    ]
    if states:
        output.say(
            f"About your code: {' and '.join(states)}, see above. The files of these records are "
            "intact."
        )

    return others


def _reevaluate_all(database: "Results", accept_changed: bool) -> list["Repeated"]:
    """Repeats the last evaluation of every finished run; prints those that aren't equal."""
    from jbench.store.provenance import describe_changes
    from jbench.training.repeat import changes_since, reevaluate
    from jbench.training.repeated_rows import Repeated

    records = [record for record in database.scan("run")[0] if record.is_finished]
    outcomes = []
    with output.progress("reevaluate", len(records), "runs") as progress:
        for done, record in enumerate(records, 1):
            try:
                outcomes.append(reevaluate(database, record, accept_changed))
            except WorkError as error:
                outcomes.append(Repeated(record.id, "not comparable", str(error)))

            if outcomes[-1].verdict == "different" and (changed := changes_since(record)):
                reason = f"{outcomes[-1].reason} Since then, {describe_changes(changed)}."
                outcomes[-1] = outcomes[-1]._replace(reason=reason)
            progress(done)

    for outcome in outcomes:
        if outcome.verdict in ("different", "not comparable"):
            output.say(f"run {outcome.run}\n  {outcome.verdict}: {outcome.reason}")

    verdicts = [outcome.verdict for outcome in outcomes if outcome.verdict != "no policy"]
    if without := len(outcomes) - len(verdicts):
        left_out = counted(without, "finished run")
        output.say(f"Left out {left_out} without a saved policy; --json lists them.")

    output.say(
        f"Repeated the last evaluations of finished runs: {output.tally(verdicts) or 'none'}."
    )
    return outcomes


def reproduce(
    run: str = Argument(
        ...,
        metavar="RUN",
        help="Id of a run or its beginning, or reference/ID of a run that is shipped with jbench.",
        autocompletion=options.complete_policies,
    ),
    episodes: int | None = options.whole_number(
        None,
        unit="EPISODES",
        help="Training episodes to repeat, 0 for none (default: up to the agent's first updates).",
    ),
    accept_changed_code: bool = options.ACCEPT_CHANGED_CODE,
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Repeat parts of a run and compare them bit for bit.

    The parts are its last evaluation and its first training episodes.
    """
    os.environ.update(ONE_THREAD)  # as in training, before libraries are imported
    from jbench.policies.located import SHIPPED
    from jbench.settings.recorded import recorded_episode_steps
    from jbench.store.code import have_changed
    from jbench.store.provenance import describe_changes
    from jbench.store.shipped import shipped_results
    from jbench.training import repeat

    # A shipped run needs no results directory.
    database = shipped_results() if run.startswith(SHIPPED) else parsing.results_to_read(results)
    record = database.find("run", database.complete_id("run", run.removeprefix(SHIPPED)))
    if record is None:
        raise database.no_run(run)

    episodes = repeat.default_episodes(record) if episodes is None else episodes
    code = repeat.changed_code(record, database, accept_changed_code)
    evaluation = None
    if record.is_finished:
        evaluation = repeat.reevaluate(database, record, accept_changed_code)

    retraining = None
    if not episodes and (evaluation is None or evaluation.verdict == "no policy"):
        reason = "has not finished" if evaluation is None else "was saved without its policy"
        raise RequestError(f"{record.id} {reason}: type --episodes 1 or more.")

    if episodes:
        number = max(1, min(episodes, record.rows("episodes")))
        total = number * recorded_episode_steps(record.settings)  # if none ended early
        with output.progress(f"reproduce {record.id}", total, "control steps") as progress:
            retraining = repeat.retrain(database, record, episodes, progress, accept_changed_code)

    changed = repeat.changes_since(record)
    unfinished = f"not repeated; the run is {record.status}."
    output.say(f"run {record.id}\n  evaluation: {_sentence(evaluation) or unfinished}")
    output.say(f"  training: {_sentence(retraining) or 'not repeated.'}")
    if code:
        output.say(f"  The code has changed: {have_changed(code)} since the run began.")
    if changed:
        output.say(f"  Since the run began, {describe_changes(changed)}.")

    parts = {"evaluation": evaluation, "training": retraining}
    repeated = [part for part in parts.values() if part is not None]
    equal = all(part.verdict != "different" for part in repeated)
    entries = {name: part and part._asdict() for name, part in parts.items()}
    output.document({"run": record.id, "equal": equal, **entries, "changed": changed, "code": code})
    if not equal:
        raise WorkError(f"{record.id} was not reproduced: {_reason(record, code, changed)}.")
    if all(part.control_steps is None for part in repeated):
        raise WorkError(f"Nothing of {record.id} could be compared; type --episodes 1 or more.")


def _reason(run: "Record", code: Sequence[str], changed: Mapping[str, object]) -> str:
    """Returns why a run was not reproduced, from the changes of its code and of the versions."""
    from jbench.store.code import have_changed
    from jbench.tasks.find import EPISODES_REPEAT

    if run.manifest.provenance.get(EPISODES_REPEAT) is False:
        return "its task makes other episodes of the same seed and actions"
    if code:
        return f"the code has changed: {have_changed(code)}"
    if changed:
        return f"{', '.join(changed)} changed since then, and may round numbers differently"
    return "versions and processor are the same, so the record was altered or is incomplete"


def _sentence(part: "Repeated | None") -> str:
    """Returns what a run that was trained again has shown."""
    if part is None or part.verdict != "equal":
        return f"{part.verdict}. {part.reason}" if part else ""
    returns = f"returns of {counted(len(part.recorded), 'episode')}"
    until = f"up to control step {part.control_steps:,}"
    return f"equal. The {returns}, {until}, are the recorded ones. {part.reason}".rstrip()
