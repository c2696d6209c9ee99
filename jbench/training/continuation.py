"""The finished runs that longer ones continue, and what prevents it.

Steps are part of a run's settings, so a run that continues one whose last checkpoint was kept
(`--keep-state`) has a record of its own, which begins with a copy that `run_batch` makes. Training
does not depend on the number of steps to come, except on a sequence of robots.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator

from jbench.agents.find import find_class
from jbench.agents.plugin import Agent, is_resumable
from jbench.errors import RequestError
from jbench.names import KeepState
from jbench.settings.engines import ENGINES
from jbench.settings.recorded import read_run
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.tasks.find import find_task
from jbench.wording import in_matrix_file


def continued_runs(run: RunSettings, results: Results, *free: str) -> list[Record]:
    """Returns the runs whose state a run can continue: finished ones, as `shorter_runs` does.

    A run whose changed code was accepted also continues the run of the code before.
    """
    origins = list[Record]()
    if run.accepted is not None:
        run = run.model_copy(update={"accepted": None})
        before = results.find_readable("run", run.id)
        if before is not None:
            origins.append(before)
    if run.robots == 1:
        origins += shorter_runs(run, results, *free)
    return [record for record in origins if record.roles()]


def shorter_runs(run: RunSettings, results: Results, *free: str) -> list[Record]:
    """Returns finished runs with fewer steps, longest first; they may differ in `free`, too."""
    same = {name: getattr(run, name) for name in ("steps", *free)}
    records, _ = results.scan("run", f"{run.id.rpartition('-')[0]}-")
    shorter = []
    for record in records:
        if not record.is_finished:
            continue

        other = read_run(record.settings)
        if not isinstance(other, RunSettings) or other.steps >= run.steps:
            continue
        if other.model_copy(update=same) == run:
            shorter.append(record)

    return sorted(shorter, key=lambda record: -record.settings["steps"])


def new_beginnings(runs: Iterable[RunSettings], results: Results) -> Iterator[str]:
    """Yields sentences on new runs that can't continue the shorter ones that are finished."""
    counts = Counter(filter(None, (_new_beginning(run, results) for run in runs)))
    for (steps, reason), count in counts.items():
        clause = f"{count:,} runs train from the beginning, not from the end of finished runs"
        if count == 1:
            clause = "1 run trains from the beginning, not from the end of a finished run"
        yield f"{clause} of {steps:,} control steps: {reason}."


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
        key = in_matrix_file(f"every = {every}", "evaluation")
        reason = f"evaluations have another distance; type --evaluate-every {every} {key}"
        return kept[0].settings["steps"], reason
    return None


def check_state_can_be_kept(runs: Iterable[RunSettings], keep: KeepState = "whole") -> None:
    """Raises a RequestError if no longer run could continue one of these runs."""
    option = "--keep-state"
    if keep == "compact":
        option = "--keep-compact-state"

    for run in runs:
        refused = f"A finished run of {run.algo} can't be continued"
        reason = obstacle(run)
        if reason is not None:
            raise RequestError(f"{refused}: {reason}; leave {option} out.")

        reason = _end_within_episode(run)
        if reason is not None:
            enough = math.lcm(_distance_of_ends(run), run.rollout)
            steps = -(-run.steps // enough) * enough  # rounded up
            raise RequestError(f"{refused}: {reason}; type --steps {steps}, or leave {option} out.")

        reason = None
        if keep == "compact":
            reason = _compact_obstacle(run)
        if reason is not None:
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
    if not ENGINES[run.engine].asks_agents_for_state:
        return None

    kind = find_class(run.algo)
    if issubclass(kind, Agent) and is_resumable(kind):
        return None
    return f"the agent {run.algo} has no state and restore"
