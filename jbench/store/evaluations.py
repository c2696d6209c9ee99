"""The evaluation episodes of runs: their own, and those of `jbench evaluate RUN` that join them."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.store.database import Results
from jbench.store.record import Record

if TYPE_CHECKING:  # jbench runs does without pandas
    import pandas as pd

ADDED = 1_000_000
"""Number of the first episode that `jbench evaluate` adds: never the first of an evaluation."""

Recorded = Mapping[str, Any]
"""Settings from a manifest: untrusted."""


def joined_runs(
    runs: Mapping[str, Recorded], evaluations: Iterable[tuple[str, str, Recorded]]
) -> dict[str, str]:
    """Returns, by evaluation, the run whose last evaluation its episodes join.

    An evaluation joins if it is finished, and was made on the run's task and its last robot, with
    random targets and the run's own code. Of several evaluations with one seed, which have the same
    first episodes, only the longest joins.

    Args:
        runs: settings by id.
        evaluations: id, status and settings of each evaluation.
    """
    longest: dict[tuple[str, str], tuple[int, str]] = {}
    for name, status, settings in evaluations:
        policy = str(settings.get("policy"))
        run = runs.get(policy)
        if run is None or status != "finished" or settings.get("accepted") is not None:
            continue

        made_on = [settings.get(key) for key in ("task", "augment", "target_yaw")]
        episodes = settings.get("episodes")
        if made_on == [run.get("task"), _last_robot(run), None] and isinstance(episodes, int):
            key = (policy, str(settings.get("seed")))
            longest[key] = max(longest.get(key, (0, "")), (episodes, name))

    return {name: run for (run, _), (_, name) in longest.items()}


def _last_robot(run: Recorded) -> int | None:
    """Returns the number of the robot on which a run ended; None for the plain one."""
    first = run.get("augment")
    robots = run.get("robots", 1)
    if isinstance(first, int) and isinstance(robots, int):
        return first + robots - 1
    return None


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
    which = rows["evaluation"].to_numpy()
    returns = rows["episode_return"].to_numpy()
    if len(which):
        returns = np.concatenate([returns, *added])
        which = np.append(which, np.full(len(returns) - len(which), which.max()))
    return which, returns


def last_evaluation_episodes(run: Record, added: Sequence[NDArray[np.float64]] = ()) -> int:
    """Returns the number of episodes of the last evaluation of a run; 0 without evaluations."""
    which, _ = evaluation_returns(run, added)
    return int(np.count_nonzero(which == which.max(initial=0)))


def with_added_episodes(
    evaluations: pa.Table, runs: "pd.DataFrame", tables: Mapping[str, "pd.DataFrame"]
) -> pa.Table:
    """Returns the table `evaluations` with those of `jbench evaluate` that join runs.

    The tables are `runs`, `policy_evaluations` and `policy_episodes`.
    """
    about = tables["policy_evaluations"]
    settings_of_runs = dict(zip(runs["run"], map(json.loads, runs["settings"]), strict=True))
    settings = map(json.loads, about["settings"])
    described = zip(about["evaluation"], about["status"], settings, strict=True)
    joined = joined_runs(settings_of_runs, described)
    if not joined or not evaluations.num_rows:
        return evaluations

    episodes = tables["policy_episodes"]
    added = episodes.assign(run=episodes["evaluation"].astype(str).map(joined)).dropna(subset="run")
    keys = ["run", "evaluation", "control_steps", "processor_time"]
    last = evaluations.select(keys).to_pandas(use_threads=False).astype({"run": str})
    last = last.sort_values("evaluation").groupby("run", as_index=False).last()
    more = added[["run", "episode_return"]].merge(last, on="run")
    if more.empty:
        return evaluations

    more = more.assign(episode=np.arange(len(more)) + ADDED)
    rows = pa.Table.from_pandas(more[evaluations.column_names], preserve_index=False)
    return pa.concat_tables([evaluations, rows.cast(evaluations.schema)])
