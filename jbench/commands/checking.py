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
    document = checked._asdict()
    document["findings"] = [flaw._asdict() for flaw in checked.findings]
    document["other_code"] = [record._asdict() for record in others]
    repeated = []
    if reevaluate:
        repeated = _reevaluate_all(database, accept_changed_code)
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
    different = sum(part.verdict == "different" for part in compared)
    if different:
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
            if flaw.sort == "warning":
                output.say(f"  Warning: {flaw}")
            else:
                output.say(f"  {flaw}")

    if checked.records or checked.findings:
        state = output.tally(flaw.sort for flaw in checked.findings) or "all of them intact"
        output.say(
            f"Checked {counted(checked.records, 'record')}, {counted(checked.files, 'file')}, "
            f"{checked.bytes / 1e6:,.1f} MB: {state}."
        )
    else:
        output.say(f"There are no records in {results}, so nothing was checked.")

    if checked.left_out:
        count = counted(checked.left_out, "run")
        output.say(f"Not checked: the policy of {count}, which {LEFT_OUT}.")


def _show_other_code(database: "Results") -> list["OtherCode"]:
    """Prints the records whose users' code is not the present one, or not at hand."""
    from jbench.store.code import short_date
    from jbench.store.manifest import KINDS
    from jbench.training.present import other_code

    records = []
    for kind in KINDS:
        readable, _ = database.scan(kind)
        records += readable

    others = list(other_code(records))
    for other in others:
        output.say(f"{other.kind} {other.id}, of {short_date(other.created)}: {other.difference}.")

    changed = sum(bool(other.files) for other in others)
    missing = len(others) - changed
    states = []
    if changed:
        states.append(f"that of {counted(changed, 'record')} has changed")
    if missing:
        states.append(f"that of {counted(missing, 'record')} is not at hand")
    if states:
        output.say(
            f"About your code: {' and '.join(states)}, see above. The files of these records are "
            "intact."
        )

    return others


def _reevaluate_all(database: "Results", accept_changed: bool) -> list["Repeated"]:
    """Repeats the last evaluation of every finished run; prints those that aren't equal."""
    records = [record for record in database.scan("run")[0] if record.is_finished]
    outcomes = []
    with output.progress("reevaluate", len(records), "runs") as progress:
        for done, record in enumerate(records, 1):
            outcomes.append(_reevaluate(database, record, accept_changed))
            progress(done)

    for outcome in outcomes:
        if outcome.verdict in ("different", "not comparable"):
            output.say(f"run {outcome.run}\n  {outcome.verdict}: {outcome.reason}")

    verdicts = [outcome.verdict for outcome in outcomes if outcome.verdict != "no policy"]
    if len(verdicts) < len(outcomes):
        left_out = counted(len(outcomes) - len(verdicts), "finished run")
        output.say(f"Left out {left_out} without a saved policy; --json lists them.")

    output.say(
        f"Repeated the last evaluations of finished runs: {output.tally(verdicts) or 'none'}."
    )
    return outcomes


def _reevaluate(database: "Results", record: "Record", accept_changed: bool) -> "Repeated":
    """Returns a repeated evaluation; if it differs, the reason names what changed meanwhile."""
    from jbench.store.provenance import describe_changes
    from jbench.training.changes import changes_since
    from jbench.training.repeat import reevaluate
    from jbench.training.repeated_rows import Repeated

    try:
        outcome = reevaluate(database, record, accept_changed)
    except WorkError as error:
        return Repeated(record.id, "not comparable", str(error))

    if outcome.verdict != "different":
        return outcome

    changed = changes_since(record)
    if not changed:
        return outcome
    return outcome._replace(reason=f"{outcome.reason} Since then, {describe_changes(changed)}.")


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
    from jbench.store.code import have_changed
    from jbench.store.provenance import describe_changes
    from jbench.training import changes, repeat

    database, record = _recorded_run(run, results)
    if episodes is None:
        episodes = repeat.default_episodes(record)

    code = changes.changed_code(record, database, accept_changed_code)
    evaluation = None
    if record.is_finished:
        total = repeat.episodes_to_repeat(record)
        work = f"reproduce {record.id}, evaluation"
        with output.progress(work, total, "episodes") as progress:
            evaluation = repeat.reevaluate(database, record, accept_changed_code, progress)

    retraining = None
    if episodes == 0:
        _check_can_be_compared(record, evaluation)
    else:
        total = repeat.steps_to_repeat(record, episodes)
        work = f"reproduce {record.id}, training"
        with output.progress(work, total, "control steps") as progress:
            retraining = repeat.retrain(database, record, episodes, progress, accept_changed_code)

    changed = changes.changes_since(record)
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


def _recorded_run(run: str, results: Path) -> tuple["Results", "Record"]:
    """Returns the results that have a run, and its record; a shipped run needs no `--results`."""
    from jbench.policies.located import SHIPPED
    from jbench.store.shipped import shipped_results

    if run.startswith(SHIPPED):
        database = shipped_results()
    else:
        database = parsing.results_to_read(results)

    record = database.find("run", database.complete_id("run", run.removeprefix(SHIPPED)))
    if record is None:
        raise database.no_run(run)
    return database, record


def _check_can_be_compared(run: "Record", evaluation: "Repeated | None") -> None:
    """Raises a RequestError if nothing of a run is repeated without its training episodes."""
    if evaluation is None:
        raise RequestError(f"{run.id} has not finished: type --episodes 1 or more.")
    if evaluation.verdict == "no policy":
        raise RequestError(f"{run.id} was saved without its policy: type --episodes 1 or more.")


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
    """Returns how a part of a run compares with the recorded one; "" if it was not repeated."""
    if part is None:
        return ""
    if part.verdict != "equal":
        return f"{part.verdict}. {part.reason}"

    returns = f"returns of {counted(len(part.recorded), 'episode')}"
    until = f"up to control step {part.control_steps:,}"
    return f"equal. The {returns}, {until}, are the recorded ones. {part.reason}".rstrip()
