"""Commands that compute recorded results again: reproduce, and verify --reevaluate."""

import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Argument, Option

from jbench import names
from jbench.commands import options, parsing
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.wording import counted, with_results

if TYPE_CHECKING:
    from jbench.store import Record, Results
    from jbench.training.repeat import Repeated


def reproduce(
    run: str = Argument(
        ...,
        metavar="RUN",
        help="The id of a run or its beginning, or reference/ID of a run that is shipped with "
        "jbench.",
        autocompletion=options.complete_policies,
    ),
    episodes: int | None = Option(
        None,
        min=0,
        help="Number of training episodes to repeat, 0 for none (default: up to the agent's first "
        "updates).",
    ),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """Repeat parts of a run and compare them bit for bit.

    The parts are its last evaluation and its first training episodes.
    """
    limit_threads()
    from jbench.store.provenance import describe_changes
    from jbench.training.repeat import changes_since, default_episodes, reevaluate, retrain

    output = Output(json)
    database, record = _find_run(results, run)
    if episodes is None:
        episodes = default_episodes(record)
    finished = record.status == "finished"
    evaluation, retraining = reevaluate(database, record) if finished else None, None
    if not episodes and (evaluation is None or evaluation.verdict == "no policy"):
        reason = "has not finished" if evaluation is None else "was saved without its policy"
        raise RequestError(f"{record.id} {reason}: type --episodes 1 or more.")
    if episodes:
        total = max(1, min(episodes, record.rows("episodes"))) * names.EPISODE_STEPS
        with output.progress(f"reproduce {record.id}", total, "control steps") as progress:
            retraining = retrain(database, record, episodes, progress)
    changed = changes_since(record)
    output.say(f"run {record.id}")
    unfinished = f"not repeated; the run is {record.status}."
    output.say(f"  evaluation: {_sentence(evaluation) or unfinished}")
    output.say(f"  training: {_sentence(retraining) or 'not repeated.'}")
    if changed:
        output.say(f"  Since the run began, {describe_changes(changed)}.")
    parts = [part for part in (evaluation, retraining) if part is not None]
    equal = all(part.verdict != "different" for part in parts)
    output.document(
        {
            "run": record.id,
            "equal": equal,
            "evaluation": None if evaluation is None else evaluation._asdict(),
            "training": None if retraining is None else retraining._asdict(),
            "changed": changed,
        }
    )
    if not equal:
        why = f"{', '.join(changed)} changed since then, and may round numbers differently"
        same = "versions and processor are the same, so the record was altered or is incomplete"
        raise WorkError(f"{record.id} was not reproduced: {why if changed else same}.")
    if all(part.control_steps is None for part in parts):
        raise WorkError(
            f"Nothing of {record.id} could be compared; repeat episodes (--episodes 1)."
        )


def _find_run(path: Path, name: str) -> tuple["Results", "Record"]:
    """Returns a run and its results, by its id or the beginning, after "reference/" if shipped."""
    from jbench.policies.find import SHIPPED
    from jbench.store.shipped import shipped_results

    # A shipped run needs no results directory.
    results = shipped_results() if name.startswith(SHIPPED) else parsing.existing_results(path)
    record = results.find("run", results.complete_id("run", name.removeprefix(SHIPPED)))
    if record is None:
        runs = with_results("jbench runs", results.name)
        raise RequestError(f"There is no run {name} in {results.name}; {runs} lists them.")
    return results, record


def _sentence(part: "Repeated | None") -> str:
    """Returns what became of a part of a run that was repeated; "" if it was not."""
    if part is None:
        return ""
    if part.verdict != "equal":
        return f"{part.verdict}. {part.reason}"
    episodes = counted(len(part.recorded), "episode")
    return (
        f"equal. The returns of {episodes}, up to control step {part.control_steps:,}, are the "
        f"recorded ones. {part.reason}"
    ).rstrip()


def limit_threads() -> None:
    """Limits the libraries to one thread, as in training; call it before they are imported."""
    os.environ.update(names.ONE_THREAD)


def reevaluate_all(database: "Results", output: Output) -> list["Repeated"]:
    """Repeats the last evaluation of every finished run, and prints those that are not equal.

    Damaged runs are left out, and runs without a policy are only counted.
    """
    from jbench.store.provenance import describe_changes
    from jbench.training.repeat import changes_since, reevaluate

    records = [record for record in database.scan("run")[0] if record.status == "finished"]
    outcomes = []
    with output.progress("reevaluate", len(records), "runs") as progress:
        for done, record in enumerate(records, 1):
            try:
                outcome = reevaluate(database, record)
            except WorkError:
                continue  # reported as damaged
            if outcome.verdict == "different" and (changed := changes_since(record)):
                reason = f"{outcome.reason} Since then, {describe_changes(changed)}."
                outcome = outcome._replace(reason=reason)
            outcomes.append(outcome)
            progress(done)
    for outcome in outcomes:
        if outcome.verdict in ("different", "not comparable"):
            output.say(f"run {outcome.run}\n  {outcome.verdict}: {outcome.reason}")
    counts = Counter(outcome.verdict for outcome in outcomes)
    without = counts.pop("no policy", 0)
    if without:
        left_out = counted(without, "finished run")
        output.say(f"Left out {left_out} without a saved policy; --json lists them.")
    verdicts = ", ".join(f"{count:,} {verdict}" for verdict, count in counts.items())
    output.say(f"Repeated the last evaluations of finished runs: {verdicts or 'none'}.")
    return outcomes
