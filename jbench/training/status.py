"""Status of runs in the results, and the finished runs that longer ones continue.

Steps are part of a run's settings, so a run that continues one whose last checkpoint was kept
(`--keep-state`) has a record of its own, which begins with a copy that `run_batch` makes. Nothing
but a sequence of robots depends on the number of steps.
"""

import contextlib
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

from jbench.agents.find import find_class
from jbench.agents.plugin import Agent, is_resumable
from jbench.errors import RequestError, WorkError
from jbench.names import KeepState
from jbench.settings.engines import ENGINES
from jbench.settings.evaluations import EVALUATION_EPISODES, evaluation_interval
from jbench.settings.recorded import read_run
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.provenance import differences, provenance
from jbench.store.run_line import committed_steps
from jbench.tasks.find import code_provenance, find_task
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


def run_status(run: RunSettings, results: Results) -> RunStatus:
    """Returns the status of a run."""
    try:
        record = results.find("run", run.id)
    except WorkError as error:
        return RunStatus("failed", run.steps, f"{error} {repair_hint(results.name)}")
    if record is None:
        kept = kept_runs(run, results)
        done = committed_steps(kept[0]) if kept else 0
        return RunStatus("missing", max(0, run.steps - done))
    if record.is_finished:
        return RunStatus("finished", 0)
    done = committed_steps(record) if record.roles() else 0
    left = max(0, run.steps - done)
    return RunStatus(record.status, left, record.error or "", will_fail_again(record))


def will_fail_again(record: Record) -> bool:
    """Returns whether a run failed by its own numbers, and the same code and machine repeat it."""
    by_numbers = {"diverged", "episode_failed"} & record.manifest.summary.keys()
    if record.status != "failed" or not by_numbers:
        return False
    try:
        now = {**provenance(), **code_provenance(record.settings["task"])}
    except (RequestError, WorkError):  # the code is not here
        return False
    now.pop("threads")  # of a worker, which may be other than this process
    return not differences(record.manifest.provenance, now)


def run_statuses(runs: Iterable[RunSettings], results: Results) -> dict[str, RunStatus]:
    """Returns the status of each run by id."""
    return {run.id: run_status(run, results) for run in runs}


def sentences(statuses: Mapping[str, RunStatus], retry_failed: bool) -> Iterator[str]:
    """Yields sentences on existing runs, with the errors of failed ones."""
    total = len(statuses)
    finished = [id for id, status in statuses.items() if status.state == "finished"]
    unfinished = [id for id, status in statuses.items() if status.state == "unfinished"]
    failed = failures_among(statuses)

    if finished:
        count = len(finished)
        which = f"{count} of {counted(total, 'run')} {are(count)}"
        subject = f"The run {finished[0]} is" if total == 1 else which
        rest = "; nothing to do" if count == total else ""
        yield f"{subject} already finished{rest}."
    if unfinished:
        count = len(unfinished)
        which = f"{counted(count, 'run')} {are(count)}"
        yield f"{which} unfinished: interrupted, or another process is training."

    for id, error in failed.items():
        yield f"The run {id} failed before: {error}"
    certain = sum(statuses[id].fails_again for id in failed)
    if certain:
        which = f"{counted(certain, 'run')} of these would fail again"
        yield f"{which}: the same numbers, code and machine make the same error."
    if others := len(failed) - certain:
        how = "trying again" if retry_failed else "--retry-failed tries again"
        yield f"{counted(others, 'run')} failed before; {how}."


def record_failure(run: RunSettings, results: Results, reason: str) -> None:
    """Marks a run as failed, unless it has failed or finished, or a process is training it."""
    with contextlib.suppress(RequestError, WorkError), results.locked("run", run.id) as existing:
        record = existing or results.create("run", run.id, run.values)
        if record.status == "unfinished":
            record.fail(reason)


def failures_among(statuses: Mapping[str, RunStatus]) -> dict[str, str]:
    """Returns the errors of failed runs by id."""
    return {id: status.error for id, status in statuses.items() if status.state == "failed"}


def kept_runs(run: RunSettings, results: Results, *free: str) -> list[Record]:
    """Returns the runs whose state a run can continue: finished ones, as `shorter_runs` does.

    A run that goes on with changed code also continues the run of the code before.
    """
    origins = list[Record]()
    if run.accepted is not None:
        run = run.model_copy(update={"accepted": None})
        before = results.find_readable("run", run.id)
        if before is not None:
            origins.append(before)
    shorter = shorter_runs(run, results, *free) if run.robots == 1 else []
    return [record for record in (*origins, *shorter) if record.roles()]


def shorter_runs(run: RunSettings, results: Results, *free: str) -> list[Record]:
    """Returns finished runs with fewer steps, longest first; they may differ in `free`, too."""
    same = {name: getattr(run, name) for name in ("steps", *free)}
    records, _ = results.scan("run", f"{run.id.rpartition('-')[0]}-")
    shorter = [
        record
        for record in records
        if record.is_finished
        and isinstance(other := read_run(record.settings), RunSettings)
        and other.steps < run.steps
        and other.model_copy(update=same) == run
    ]
    return sorted(shorter, key=lambda record: -record.settings["steps"])


def with_kept_evaluations(
    runs: list[RunSettings], results: Results, typed: Mapping[str, Any]
) -> list[RunSettings]:
    """Returns runs with the evaluations of recorded ones that they are, or can continue.

    They are those of a run with the same settings whose evaluations are the defaults of older
    versions, or else those of a finished run that new ones continue. Evaluations are as typed if
    the user has typed how often they are.

    Args:
        typed: evaluate_every and evaluate_episodes, None if the user did not type them.
    """
    free = [name for name in ("evaluate_every", "evaluate_episodes") if typed[name] is None]
    if "evaluate_every" not in free:
        return runs
    if any(run_status(run, results).state != "missing" for run in runs):
        return runs
    older = [run.model_copy(update=_older_evaluations(run, free)) for run in runs]
    if older != runs and any(run_status(run, results).state != "missing" for run in older):
        return older

    for run in runs:
        for continued in kept_runs(run, results, *free):
            changes = {name: continued.settings[name] for name in free}
            return [each.model_copy(update=changes) for each in runs]
    return runs


def _older_evaluations(run: RunSettings, free: Sequence[str]) -> dict[str, int]:
    """Returns the default evaluations of versions in which a short run had those of a long one."""
    usual = {
        "evaluate_every": evaluation_interval(run.steps, run.episode_steps),
        "evaluate_episodes": EVALUATION_EPISODES,
    }
    return {name: usual[name] for name in free}


def new_beginnings(runs: Iterable[RunSettings], results: Results) -> Iterator[str]:
    """Yields sentences on new runs that can't continue the shorter ones that are finished."""
    counts = Counter(filter(None, (_new_beginning(run, results) for run in runs)))
    for (steps, reason), count in counts.items():
        if count == 1:
            what = "1 run trains from the beginning, not from the end of a finished run"
        else:
            what = f"{count:,} runs train from the beginning, not from the end of finished runs"
        yield f"{what} of {steps:,} control steps: {reason}."


def _new_beginning(run: RunSettings, results: Results) -> tuple[int, str] | None:
    """Returns the steps of the run that a new run does not continue, and the reason.

    None if the new run continues one, or there is none.
    """
    shorter = shorter_runs(run, results, "evaluate_every")
    same = [each for each in shorter if each.settings["evaluate_every"] == run.evaluate_every]
    kept = [each for each in shorter if each.roles()]
    if run.robots == 1 and any(each.roles() for each in same):
        return None

    if same:
        reason = obstacle(run) or "the state was not kept, as --keep-state does"
        return same[0].settings["steps"], reason
    if kept:
        every = kept[0].settings["evaluate_every"]
        reason = f"evaluations have another distance; type --evaluate-every {every}"
        return kept[0].settings["steps"], reason
    return None


def check_state_can_be_kept(runs: Iterable[RunSettings], keep: KeepState = "whole") -> None:
    """Raises a RequestError if no longer run could continue one of these runs."""
    option = "--keep-compact-state" if keep == "compact" else "--keep-state"
    for run in runs:
        refused = f"A finished run of {run.algo} can't be continued"
        if (reason := obstacle(run)) is not None:
            raise RequestError(f"{refused}: {reason}; leave {option} out.")
        if (reason := _end_within_episode(run)) is not None:
            enough = math.lcm(_distance_of_ends(run), run.rollout)
            steps = -(-run.steps // enough) * enough  # rounded up
            raise RequestError(f"{refused}: {reason}; type --steps {steps}, or leave {option} out.")
        if keep == "compact" and (reason := _compact_obstacle(run)) is not None:
            raise RequestError(
                f"A run of {run.algo} has no compact state: {reason}; type --keep-state."
            )


def _distance_of_ends(run: RunSettings) -> int:
    """Returns the control steps from one end of the run's episodes to the next."""
    return run.episode_steps * run.environments


def _end_within_episode(run: RunSettings) -> str | None:
    """Returns why a run has no state at its end, if it ends within an episode; else None."""
    is_between = run.last_step % _distance_of_ends(run) == 0
    if is_between or find_task(run.task).has_state_within_episode:
        return None
    return (
        f"{run.task} has a state between two episodes only, and the run's last control step is "
        f"the {run.last_step:,}th"
    )


def _compact_obstacle(run: RunSettings) -> str | None:
    """Returns why the replay buffer of a run can't follow from its actions; None if it can."""
    capacity = run.replay_capacity
    if capacity is None:
        return None

    task = find_task(run.task)
    if not task.repeats():
        return f"{run.task} makes other episodes of the same seed and actions"
    if task.ends_early and run.environments > 1 and run.last_step > capacity:
        return (
            "its replay buffer forgets the beginnings of episodes, which end early in several "
            "environments"
        )
    return None


def obstacle(run: RunSettings, finished: bool = True) -> str | None:
    """Returns why a finished run can't be continued, or another one resumed; None if it can."""
    if finished and run.robots > 1:
        return "the steps of each robot in a sequence depend on the total"
    if not ENGINES[run.engine].has_checkpoints:
        return "stable-baselines3 has no checkpoints here"
    if run.engine != "plugin":
        return None
    kind = find_class(run.algo)
    resumable = issubclass(kind, Agent) and is_resumable(kind)
    return None if resumable else f"the agent {run.algo} has no state and restore"
