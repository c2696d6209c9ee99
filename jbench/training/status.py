"""Status of runs in the results."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.store import Results, locks
from jbench.training.continuation import kept_runs
from jbench.wording import are, counted

State = Literal["finished", "partial", "failed", "missing"]


class RunStatus(NamedTuple):
    """Status of a run; `error` is that of a failed run, or of an unreadable record."""

    state: State
    steps_left: int
    error: str = ""

    @property
    def is_ended(self) -> bool:
        """Whether the run has finished or failed."""
        return self.state in ("finished", "failed")


class Plan(NamedTuple):
    """The runs of a command and their statuses before it starts, by run id."""

    runs: Sequence[RunSettings]
    statuses: Mapping[str, RunStatus]

    def ids(self, state: State) -> list[str]:
        """Returns the ids of the runs in a state."""
        return [run.id for run in self.runs if self.statuses[run.id].state == state]

    def to_do(self, retry_failed: bool) -> list[RunSettings]:
        """Returns the runs to train: failed ones only if they are retried."""
        done = ("finished",) if retry_failed else ("finished", "failed")
        return [run for run in self.runs if self.statuses[run.id].state not in done]

    def sentences(self, retry_failed: bool) -> Iterator[str]:
        """Yields sentences on existing runs, with the errors of failed ones."""
        finished, partial, failed = (self.ids(s) for s in ("finished", "partial", "failed"))
        if finished:
            rest = "" if self.to_do(retry_failed) or failed else "; nothing to do"
            count = f"{len(finished)} of {counted(len(self.runs), 'run')} {are(len(finished))}"
            subject = f"The run {finished[0]} is" if len(self.runs) == 1 else count
            yield f"{subject} already finished{rest}."
        if partial:
            count = f"{counted(len(partial), 'run')} {are(len(partial))}"
            yield f"{count} unfinished: interrupted, or another process is training."
        for id in failed:
            yield f"The run {id} failed before: {self.statuses[id].error}"
        if failed:
            how = "trying again" if retry_failed else "--retry-failed tries again"
            yield f"{counted(len(failed), 'run')} failed before; {how}."


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
    left = max(0, run.steps - done)
    if record.error is not None:
        return RunStatus("failed", left, record.error)
    return RunStatus("partial", left)


def run_statuses(runs: Iterable[RunSettings], results: Results) -> dict[str, RunStatus]:
    """Returns the status of each run by id."""
    return {run.id: run_status(run, results) for run in runs}


def plan(runs: Sequence[RunSettings], results: Results) -> Plan:
    """Returns the status of each run; removes temporary files of interrupted writers."""
    for run in runs:
        results.clean("run", run.id)
    return Plan(runs, run_statuses(runs, results))


def is_being_trained(run: RunSettings, results: Results) -> bool:
    """Returns whether a process is currently training a run."""
    return locks.is_held(results.record("run", run.id).path)


def record_failure(run: RunSettings, results: Results, reason: str) -> None:
    """Marks a run as failed, unless it has failed or finished, or a process is training it."""
    with contextlib.suppress(RequestError, WorkError), results.locked("run", run.id) as existing:
        record = existing or results.create("run", run.id, run.values)
        if record.status == "unfinished":
            record.fail(reason)


def failures_among(statuses: Mapping[str, RunStatus]) -> dict[str, str]:
    """Returns the errors of failed runs by id."""
    return {id: status.error for id, status in statuses.items() if status.state == "failed"}
