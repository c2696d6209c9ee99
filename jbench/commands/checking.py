"""Commands that compute recorded results again: reproduce, and verify --reevaluate."""

import os
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jbench import names
from jbench.commands import parsing
from jbench.commands.options import RESULTS, JsonOption, ReadResultsOption, complete_policies
from jbench.commands.output import Output
from jbench.errors import RequestError, WorkError
from jbench.wording import counted

if TYPE_CHECKING:
    from jbench.store import Record, Results
    from jbench.training.reevaluate import Reevaluation
    from jbench.training.reproduce import Reproduction


def reproduce(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            help="The id of a run or its beginning, or reference/ID of a run that is shipped with "
            "jbench.",
            autocompletion=complete_policies,
        ),
    ],
    episodes: Annotated[
        int | None,
        typer.Option(
            help="Number of training episodes to repeat, 0 for none (default: up to the agent's "
            "first updates)."
        ),
    ] = None,
    results: ReadResultsOption = RESULTS,
    json: JsonOption = False,
) -> None:
    """Repeat parts of a run and compare them bit for bit.

    The parts are its last evaluation and its first training episodes.
    """
    limit_threads()
    from jbench.policies.find import SHIPPED
    from jbench.training import reproduce as repeating

    if episodes is not None and episodes < 0:
        raise RequestError(f"--episodes {episodes}: type 0 or more.")
    output = Output(json)
    # A shipped run needs no results directory.
    open_results = parsing.results_at if run.startswith(SHIPPED) else parsing.existing_results
    database, record = repeating.find_run(open_results(results), run)
    if episodes is None:
        episodes = repeating.default_episodes(record)
    total = max(1, min(episodes, record.rows("episodes"))) * names.EPISODE_STEPS
    with output.progress(f"reproduce {record.id}", total, "control steps") as progress:
        done = repeating.reproduce(database, record, episodes, progress)
    _say(done, record, output)
    output.document(_document(done))
    if not done.equal:
        raise WorkError(_not_equal(done))
    if not done.compared:
        raise WorkError(f"Nothing of {done.run} could be compared; repeat episodes (--episodes 1).")


def limit_threads() -> None:
    """Limits the libraries to one thread, as in training; call it before they are imported."""
    os.environ.update(names.ONE_THREAD)


def reevaluate_all(database: "Results", output: Output) -> list["Reevaluation"]:
    """Repeats the last evaluation of every finished run, and prints those that are not equal.

    Damaged runs are left out, and runs without a policy are only counted.
    """
    from jbench.store.provenance import differences, provenance, sentence_of
    from jbench.training.reevaluate import reevaluate

    records = [record for record in database.scan("run")[0] if record.status == "finished"]
    outcomes = []
    with output.progress("reevaluate", len(records), "runs") as progress:
        for done, record in enumerate(records, 1):
            try:
                outcome = reevaluate(database, record)
            except WorkError:
                continue  # reported as damaged
            changed = differences(record.manifest.provenance, provenance())
            if outcome.verdict == "different" and changed:
                reason = f"{outcome.reason} Since then, {sentence_of(changed)}."
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


def _say(done: "Reproduction", record: "Record", output: Output) -> None:
    from jbench.store.provenance import sentence_of

    output.say(f"run {done.run}")
    evaluation, retraining = done.evaluation, done.retraining
    if evaluation is None:
        output.say(f"  evaluation: not repeated, since the run is {record.status}.")
    elif evaluation.verdict == "equal":
        output.say(
            f"  evaluation: equal. The kept policy has the recorded return in each of "
            f"{counted(len(evaluation.recorded), 'episode')} "
            f"(control step {evaluation.control_steps:,})."
        )
    else:
        output.say(f"  evaluation: {evaluation.verdict}. {evaluation.reason}")
    if retraining is None:
        output.say("  training: not repeated.")
    elif retraining.difference is not None:
        output.say(f"  training: different. The first difference is {retraining.difference}.")
    else:
        output.say(
            f"  training: equal, up to control step {retraining.control_steps:,} (rows of training "
            f"episodes: {retraining.episodes}, of evaluations: {retraining.evaluations})."
        )
    if retraining is not None and not retraining.updated:
        output.say("  Note: the agent was not updated in these episodes; repeat more of them.")
    if done.changed:
        output.say(f"  Since the run began, {sentence_of(done.changed)}.")


def _not_equal(done: "Reproduction") -> str:
    """Returns the sentence that ends the command."""
    if not done.changed:
        why = "versions and processor are the same, so the record was altered or is incomplete"
    else:
        changed = ", ".join(done.changed)
        why = f"{changed} changed since then, and may round numbers differently"
    return f"{done.run} was not reproduced: {why}."


def _document(done: "Reproduction") -> dict[str, Any]:
    retraining = None
    if done.retraining is not None:
        difference = done.retraining.difference
        retraining = done.retraining._asdict()
        retraining["difference"] = None if difference is None else difference._asdict()
    return {
        "run": done.run,
        "equal": done.equal,
        "evaluation": None if done.evaluation is None else done.evaluation._asdict(),
        "training": retraining,
        "changed": done.changed,
    }
