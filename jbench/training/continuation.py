"""Longer runs that continue finished ones, whose last checkpoint was kept (`--keep-state`).

Steps are part of a run's settings, so the longer run has a record of its own. It begins with a copy
of the shorter run's rows and checkpoint, and ends with the rows and weights of a run trained at
once, since nothing but a sequence of robots depends on the number of steps. `begin` in
`jbench.training.batch_member` makes the copy.
"""

from collections import Counter
from collections.abc import Iterable, Iterator

from jbench.agents.algorithms import find_agent
from jbench.agents.plugin import is_resumable
from jbench.errors import RequestError
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.wording import counted


def kept_runs(run: RunSettings, results: Results) -> list[Record]:
    """Returns the finished runs that a run can continue, the longest first."""
    return [record for record in shorter_runs(run, results) if _has_state(run, record)]


def shorter_runs(run: RunSettings, results: Results) -> list[Record]:
    """Returns the finished runs that differ only in having fewer steps, the longest first."""
    records, _ = results.scan("run", f"{run.id.rpartition('-')[0]}-")
    shorter = [
        record
        for record in records
        if record.status == "finished"
        and {**record.settings, "steps": run.steps} == run.values
        and record.settings["steps"] < run.steps
    ]
    return sorted(shorter, key=lambda record: -record.settings["steps"])


def _has_state(run: RunSettings, record: Record) -> bool:
    return run.robots == 1 and bool(record.roles())


def new_beginnings(runs: Iterable[RunSettings], results: Results) -> Iterator[str]:
    """Yields sentences on new runs that can't continue the shorter ones that are finished."""
    reasons: Counter[tuple[int, str]] = Counter()
    for run in runs:
        shorter = shorter_runs(run, results)
        if shorter and not any(_has_state(run, record) for record in shorter):
            why = obstacle(run) or "their state was not kept, which --keep-state does"
            reasons[shorter[0].settings["steps"], why] += 1
    for (steps, why), count in reasons.items():
        verb = "trains" if count == 1 else "train"
        yield (
            f"{counted(count, 'run')} {verb} from the beginning, not from the end of finished runs "
            f"of {steps:,} control steps: {why}."
        )


def check_state_can_be_kept(runs: Iterable[RunSettings]) -> None:
    """Raises a RequestError if a run's state is no use, since no longer run can continue it."""
    for run in runs:
        reason = obstacle(run)
        if reason is not None:
            raise RequestError(
                f"No longer run can continue a run of {run.algo}: {reason}; leave --keep-state out."
            )


def obstacle(run: RunSettings) -> str | None:
    """Returns why runs of these settings can't be continued, as a clause; None if they can."""
    if run.robots > 1:
        return "the steps of each robot in a sequence depend on the total"
    if run.engine == "sb3":
        return "stable-baselines3 has no checkpoints here"
    if run.engine == "plugin" and not is_resumable(find_agent(run.algo)):
        return f"the agent {run.algo} has no state and restore"
    return None
