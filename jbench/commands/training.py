"""What train and sweep have in common: training with its progress, and what is said afterwards."""

from collections.abc import Callable, Collection, Sequence, Sized
from contextlib import ExitStack
from functools import partial
from typing import Any

from jbench.commands import output
from jbench.commands.training_view import TrainingView
from jbench.errors import ElsewhereError, WorkError
from jbench.loggers.logger import copying_rows, make_logger
from jbench.names import SWEEPS, KeepState
from jbench.numbers import whole
from jbench.settings.base import task_and_representation
from jbench.settings.evaluations import EVALUATION_EPISODES
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.evaluations import added_returns, last_evaluation_episodes
from jbench.store.run_line import RunLine, line_with_returns
from jbench.sweeps.cell import Cell, all_runs
from jbench.sweeps.preparation import missing_encoders, warnings_of_epochs
from jbench.sweeps.scheduler import Executor, sweep
from jbench.training.events import Event, Note, Warned
from jbench.training.status import failures_among, run_statuses, will_fail_again
from jbench.wording import counted, with_results


def worker_options(
    keep_state: KeepState, final_episodes: int | None, checkpoint_every: float
) -> dict[str, Any]:
    """Returns the options of `run_batch` that users type."""
    return {
        "keep_state": keep_state,
        "final_episodes": final_episodes,
        "checkpoint_every": checkpoint_every,
    }


def train_cells(
    cells: Sequence[Cell],
    results: Results,
    make_executor: Callable[[], Executor],
    log: str | None,
    **options: Any,
) -> dict[str, str]:
    """Trains the missing runs of cells, and shows their progress; returns and raises as `sweep`.

    Their rows are copied to the experiment tracker `log`, if any, whose library must be installed.
    `options` are other ones of `sweep`.
    """

    def show(event: Event) -> None:
        if isinstance(event, Note):
            output.say(event.text)
        elif isinstance(event, Warned):
            output.warn_once(event.text)
        else:
            view.show(event)

    with ExitStack() as stack:
        if log is not None:
            logger = make_logger(log, results.path)
            ids = {run.id for run in all_runs(cells)}
            output.say(logger.where)
            stack.enter_context(copying_rows(results, ids, logger, output.warn))

        view = stack.enter_context(TrainingView())
        return sweep(cells, results, make_executor, show, **options)


def check_failures(failures: Collection[str], runs: int, results: Results) -> None:
    """Raises a WorkError if some of a number of runs have failed, of which these are the ids.

    A run is not recorded as failed if only the disk or its encoder was at fault.
    """
    if not failures:
        return

    records = [results.find_readable("run", id) for id in failures]
    recorded = [record for record in records if record is not None and record.status == "failed"]
    advice = "the same command tries again"
    if len(recorded) == len(failures) and all(map(will_fail_again, recorded)):
        advice = "the same numbers, code and machine make the same error again"
    elif recorded:
        advice = "--retry-failed tries again"

    raise WorkError(f"{len(failures)} of {counted(runs, 'run')} failed; {advice}.")


def check_left(left: Sized, runs: int) -> None:
    """Raises an ElsewhereError if other processes are training some of a number of runs."""
    if left:
        raise ElsewhereError(
            f"Another process is training {len(left)} of {counted(runs, 'run')}; jbench runs "
            "shows how far it is, and when it has ended, the same command trains what is left."
        )


def _about_final_returns(episodes: int) -> str:
    """Returns what final returns are, and which to quote.

    Args:
        episodes: the fewest in the last evaluation of a run; 0 if no run has evaluations.
    """
    quoted = "Quote the evaluation return: the mean over the last evaluation"
    if 0 < episodes < EVALUATION_EPISODES:
        quoted = (
            f"The evaluation return is the mean of {counted(episodes, 'episode')}, too few to "
            "quote: jbench evaluate RUN adds 100 to the last evaluation"
        )
    return (
        f"Final returns. {quoted}, in which the policy is deterministic. The training return, "
        "exploration included, is the mean over the last quarter of the episodes, at most 100."
    )


def note_encoder(typed: str, run: RunSettings) -> list[str]:
    """Returns a sentence on the encoder of a run, if its name is not the one that was typed."""
    if run.encoder is None or run.encoder_draws is not None:
        return []
    _, representation = task_and_representation(run.encoder)
    if typed == representation or run.encoder.startswith(typed):
        return []
    return [f"--encoder {typed} is {run.encoder}."]


def show_runs(runs: Sequence[RunSettings], results: Results) -> None:
    """Prints the final returns of each run in the results."""
    rows = []
    evaluated = []
    added, problems = added_returns(results, {run.id: run.model_dump() for run in runs})
    for problem in problems:
        output.warn(problem)

    for run in runs:
        try:
            record = results.find("run", run.id)
            if record is not None:
                more = added.get(run.id, ())
                line = record.reading(partial(line_with_returns, record, more))
                rows.append(_final_returns(line))
                if record.status != "failed":  # which can't be evaluated
                    count = record.reading(partial(last_evaluation_episodes, record, more))
                    evaluated.append(count)
        except WorkError as error:
            output.warn(str(error))

    if not rows:  # nothing was recorded
        return

    # They differ if jbench evaluate has added episodes.
    if all(row["evaluation return"] == row["at the end of training"] for row in rows):
        for row in rows:
            del row["at the end of training"]

    title = _about_final_returns(min(filter(None, evaluated), default=0))
    output.table(title, list(rows[0]), [list(row.values()) for row in rows])


def _final_returns(line: RunLine) -> dict[str, object]:
    """Returns the cells of a run's final returns by their columns."""
    run = line.run
    if line.status != "finished":
        run += f" ({line.status})"

    return {
        "run": run,
        "episodes": line.episodes,
        "training return": _mean(line.last_return),
        "evaluation return": _mean(line.evaluation_return),
        "at the end of training": _mean(line.evaluation_return_at_end),
    }


def _mean(value: float | None) -> str:
    """Returns a mean return as text; "" if there is none."""
    return "" if value is None else whole(value)


def show_outcome(runs: Sequence[RunSettings], results: Results, failures: dict[str, str]) -> None:
    """Prints the final returns of runs and what to type next.

    Raises a WorkError if some have failed, and an ElsewhereError if others are being trained.
    """
    statuses = run_statuses(runs, results)
    failures = failures | failures_among(statuses)
    left = [id for id, run in statuses.items() if run.state not in ("finished", "failed")]
    show_runs(runs, results)
    if not left and len(failures) < len(runs):
        output.say(f"Next: {with_results('jbench report', results.name)}")

    output.document({"runs": [run.id for run in runs], "left": left, "failures": failures})
    check_failures(failures, len(runs), results)
    check_left(left, len(runs))


def show_missing(cells: Sequence[Cell], results: Results, matrix: str) -> list[str]:
    """Prints the datasets and encoders that the runs of a matrix need first; returns their ids."""
    missing = missing_encoders(cells, results)
    datasets = [data for data, _ in missing if not results.is_finished("dataset", data.id)]
    encoders = []
    for _, unfinished in missing:
        encoders += unfinished

    for dataset in datasets:
        advice = "."
        if matrix not in SWEEPS:
            advice = f"; steps under [dataset] in {matrix} makes it smaller."
        output.say(
            f"To be collected first: the dataset {dataset.id} of {dataset.steps:,} control "
            f"steps{advice}"
        )

    for dataset, unfinished in missing:
        for sentence in warnings_of_epochs(dataset, unfinished):
            output.warn(sentence)

    ids = ", ".join(encoder.id for encoder in encoders)
    if len(encoders) == 1:
        output.say(f"To be trained first: the encoder {ids}.")
    elif encoders:
        output.say(f"To be trained first: the encoders {ids}.")

    return [*(dataset.id for dataset in datasets), *(encoder.id for encoder in encoders)]
