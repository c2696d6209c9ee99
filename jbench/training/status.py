"""Status of runs in the results."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal, NamedTuple

from jbench.devices import find_device
from jbench.errors import RequestError, WorkError
from jbench.settings.engines import ENGINES
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.provenance import device_provenance, differences, process_provenance
from jbench.store.run_line import committed_steps
from jbench.tasks.find import EPISODES_REPEAT, task_provenance
from jbench.tasks.worlds import fails_by_numbers
from jbench.training.continuation import continued_runs
from jbench.wording import are, counted, repair_hint

RunState = Literal["finished", "unfinished", "failed", "missing"]


class RunStatus(NamedTuple):
    """Status of a run.

    Attributes:
        error: of a failed run, or of an unreadable record.
        fails_again: whether a failed run would fail with the same error if it were repeated.
    """

    state: RunState
    steps_left: int
    error: str = ""
    fails_again: bool = False


def run_status(run: RunSettings, results: Results, device: str = "auto") -> RunStatus:
    """Returns the status of a run, which the device would train; see `will_fail_again`."""
    try:
        record = results.find("run", run.id)
    except WorkError as error:
        return RunStatus("failed", run.steps, f"{error} {repair_hint(results.name)}")
    if record is None:
        kept = continued_runs(run, results)
        done = committed_steps(kept[0]) if kept else 0
        return RunStatus("missing", max(0, run.steps - done))
    if record.is_finished:
        return RunStatus("finished", 0)
    done = committed_steps(record) if record.roles() else 0
    left = max(0, run.steps - done)
    return RunStatus(record.status, left, record.error or "", will_fail_again(record, device))


def will_fail_again(record: Record, device: str = "auto") -> bool:
    """Returns whether a run failed by its own numbers, and the same code and machine repeat it.

    An environment whose episodes do not repeat has other numbers, and so has another device than
    the one that would train the run; see `find_device`.
    """
    summary = record.manifest.summary
    made_on = record.manifest.provenance
    if record.status != "failed" or made_on.get(EPISODES_REPEAT) is False:
        return False

    if "diverged" not in summary and not fails_by_numbers(summary):
        return False

    engine = ENGINES.get(str(record.settings.get("engine")))
    if engine is not None and not engine.is_for_gpu:
        device = "cpu"
    try:
        now = {
            **process_provenance(),
            **task_provenance(record.settings["task"]),
            **device_provenance(find_device(device)),
        }
    except (RequestError, WorkError):  # the code or the device is not here
        return False

    now.pop("threads")  # of a worker, which may be other than this process
    return not differences(made_on, now, at_end=True)


def run_statuses(
    runs: Iterable[RunSettings], results: Results, device: str = "auto"
) -> dict[str, RunStatus]:
    """Returns the status of each run by id; see `run_status`."""
    return {run.id: run_status(run, results, device) for run in runs}


def sentences(statuses: Mapping[str, RunStatus], retry_failed: bool) -> Iterator[str]:
    """Yields sentences on existing runs, with the errors of failed ones."""
    total = len(statuses)
    finished = [id for id, status in statuses.items() if status.state == "finished"]
    unfinished = [id for id, status in statuses.items() if status.state == "unfinished"]
    failed = failures_among(statuses)

    if finished:
        count = len(finished)
        clause = f"{count} of {counted(total, 'run')} {are(count)} already finished"
        if total == 1:
            clause = f"The run {finished[0]} is already finished"
        if count == total:
            clause += "; nothing to do"
        yield f"{clause}."
    if unfinished:
        count = len(unfinished)
        subject = f"{counted(count, 'run')} {are(count)}"
        yield f"{subject} unfinished: interrupted, or another process is training."

    for id, error in failed.items():
        yield f"The run {id} failed before: {error}"
    certain = sum(statuses[id].fails_again for id in failed)
    if certain:
        clause = f"{counted(certain, 'run')} of these would fail again"
        yield f"{clause}: the same numbers, code and machine make the same error."

    others = counted(len(failed) - certain, "run")
    if len(failed) == certain:
        return
    if retry_failed:
        yield f"{others} failed before; trying again."
    else:
        yield f"{others} failed before; --retry-failed tries again."


def record_failure(run: RunSettings, results: Results, reason: str) -> None:
    """Marks a run as failed, unless it has failed or finished, or a process is training it."""
    with contextlib.suppress(RequestError, WorkError), results.locked("run", run.id) as existing:
        record = existing or results.create("run", run.id, run.values)
        if record.status == "unfinished":
            record.fail(reason)


def failures_among(statuses: Mapping[str, RunStatus]) -> dict[str, str]:
    """Returns the errors of failed runs by id."""
    return {id: status.error for id, status in statuses.items() if status.state == "failed"}
