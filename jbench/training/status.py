"""Status of runs in the results."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.training.continuation import kept_runs
from jbench.wording import are, counted

State = Literal["finished", "partial", "failed", "missing"]


class RunStatus(NamedTuple):
    """Status of a run; `error` is that of a failed run, or of an unreadable record."""

    state: State
    steps_left: int
    error: str = ""


def run_status(run: RunSettings, results: Results) -> RunStatus:
    """Returns the status of a run."""
    try:
        record = results.find("run", run.id)
    except WorkError as error:
        return RunStatus("failed", run.steps, str(error))
    if record is None:
        kept = kept_runs(run, results)
        return RunStatus("missing", run.steps - (kept[0].settings["steps"] if kept else 0))
    if record.status == "finished":
        return RunStatus("finished", 0)
    done = record.rows("episodes") * EPISODE_STEPS if record.roles() else 0
    state: State = "partial" if record.error is None else "failed"
    return RunStatus(state, max(0, run.steps - done), record.error or "")


def run_statuses(runs: Iterable[RunSettings], results: Results) -> dict[str, RunStatus]:
    """Returns the status of each run by id."""
    return {run.id: run_status(run, results) for run in runs}


def plan(runs: Sequence[RunSettings], results: Results) -> dict[str, RunStatus]:
    """Returns the status of each run by id; removes temporary files of interrupted writers."""
    for run in runs:
        results.clean("run", run.id)
    return run_statuses(runs, results)


def sentences(statuses: Mapping[str, RunStatus], retry_failed: bool) -> Iterator[str]:
    """Yields sentences on existing runs, with the errors of failed ones."""
    finished, partial = (
        [id for id, status in statuses.items() if status.state == state]
        for state in ("finished", "partial")
    )
    if finished:
        rest = "; nothing to do" if len(finished) == len(statuses) else ""
        count = f"{len(finished)} of {counted(len(statuses), 'run')} {are(len(finished))}"
        subject = f"The run {finished[0]} is" if len(statuses) == 1 else count
        yield f"{subject} already finished{rest}."
    if partial:
        count = f"{counted(len(partial), 'run')} {are(len(partial))}"
        yield f"{count} unfinished: interrupted, or another process is training."
    failed = failures_among(statuses)
    for id, error in failed.items():
        yield f"The run {id} failed before: {error}"
    if failed:
        how = "trying again" if retry_failed else "--retry-failed tries again"
        yield f"{counted(len(failed), 'run')} failed before; {how}."


def record_failure(run: RunSettings, results: Results, reason: str) -> None:
    """Marks a run as failed, unless it has failed or finished, or a process is training it."""
    with contextlib.suppress(RequestError, WorkError), results.locked("run", run.id) as existing:
        record = existing or results.create("run", run.id, run.values)
        if record.status == "unfinished":
            record.fail(reason)


def failures_among(statuses: Mapping[str, RunStatus]) -> dict[str, str]:
    """Returns the errors of failed runs by id."""
    return {id: status.error for id, status in statuses.items() if status.state == "failed"}
