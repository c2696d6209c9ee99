"""The evaluation episodes of runs: their own, and those of `jbench evaluate RUN` that join them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.store.database import Results
from jbench.store.record import Record

Recorded = Mapping[str, Any]
"""Settings from a manifest: untrusted."""


def joined_runs(
    runs: Mapping[str, Recorded], evaluations: Iterable[tuple[str, str, Recorded]]
) -> dict[str, str]:
    """Returns, by evaluation, the run whose last evaluation its episodes join.

    They are on the run's task and its last robot, with random targets. Of several evaluations with
    one seed, whose episodes are the same, the longest joins.

    Args:
        runs: settings by id.
        evaluations: id, status and settings of each evaluation.
    """
    longest: dict[tuple[str, str], tuple[int, str]] = {}
    for name, status, settings in evaluations:
        run = runs.get(policy := str(settings.get("policy")))
        if run is None or status != "finished":
            continue
        where = tuple(settings.get(key) for key in ("task", "augment", "target_yaw"))
        episodes = settings.get("episodes")
        if where == (run.get("task"), _last_robot(run), None) and isinstance(episodes, int):
            key = policy, str(settings.get("seed"))
            longest[key] = max(longest.get(key, (0, "")), (episodes, name))
    return {name: run for (run, _), (_, name) in longest.items()}


def _last_robot(run: Recorded) -> int | None:
    first, robots = run.get("augment"), run.get("robots", 1)
    return first + robots - 1 if isinstance(first, int) and isinstance(robots, int) else None


def added_returns(
    results: Results, runs: Mapping[str, Recorded]
) -> tuple[dict[str, list[NDArray[np.float64]]], list[str]]:
    """Returns those of `jbench evaluate` that join runs, by run, and what could not be read."""
    records, problems = results.scan("evaluation")
    joined = joined_runs(runs, ((record.id, record.status, record.settings) for record in records))
    returns: dict[str, list[NDArray[np.float64]]] = {}
    for record in records:
        if record.id in joined:
            try:
                rows = record.read("policy_episodes")["episode_return"].to_numpy()
            except WorkError as error:
                problems.append(str(error))
            else:
                returns.setdefault(joined[record.id], []).append(rows)
    return returns, problems


def evaluation_returns(
    run: Record, added: Sequence[NDArray[np.float64]] = ()
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Returns the evaluation and the return (episodes,) of each evaluation episode of a run."""
    rows = run.read("evaluations")
    which, returns = (rows[name].to_numpy() for name in ("evaluation", "episode_return"))
    if len(which):
        returns = np.concatenate([returns, *added])
        which = np.append(which, np.full(len(returns) - len(which), which.max()))
    return which, returns
