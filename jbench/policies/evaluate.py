"""Evaluates any policy and saves its returns, and on request every state."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa

from jbench.errors import RequestError
from jbench.policies.code import policy_provenance
from jbench.policies.find import find_policy
from jbench.settings.records import EvaluationSettings
from jbench.store import Record, Results, schema
from jbench.store.code import is_known
from jbench.store.planned import Planned, planned
from jbench.tasks.find import find_task, task_provenance
from jbench.tasks.task import Act, episode_generator, rollout
from jbench.tasks.worlds import Worlds, fails_by_numbers
from jbench.wording import counted

# Robots stepped together: enough for the threads, and few enough for little memory.
_TOGETHER = 50

_Progress = Callable[[int], None]

_FREE = ("episodes", "seed", "states", "target_yaw", "augment")
"""Settings in which evaluations of one policy may differ; see `planned`."""


def evaluation_code(task: str, policy: str) -> dict[str, Any]:
    """Returns provenance of the users' code of a task and of a policy of another package."""
    return {**policy_provenance(policy), **task_provenance(task)}


def plan_evaluation(
    settings: EvaluationSettings, results: Results, name: str
) -> Planned[EvaluationSettings]:
    """Returns settings with the id of a recorded evaluation of the same code, if there is one."""
    now = evaluation_code(settings.task, name)
    if not is_known(now) or settings.accepted is not None:
        return Planned(settings, [])
    return planned(settings, results.scan("evaluation")[0], now, _FREE)


def evaluate(
    settings: EvaluationSettings,
    results: Results,
    threads: int,
    progress: _Progress = lambda steps: None,
    name: str | None = None,
) -> Record:
    """Runs and saves the episodes of a policy, unless they have been saved before.

    An episode that can't go on fails the evaluation, which keeps those that ended. Each episode has
    its own generator for pose and target. The random policy is seeded; all others are
    deterministic.

    Args:
        settings: of the evaluation, whose id they determine.
        results: with the run of the policy; they get the record.
        threads: number of threads that step the robots.
        progress: called with the control steps done, over all episodes.
        name: of the policy, if it is not that in the settings, such as the path of a file.

    Raises:
        RequestError: if there is no such policy for this task.
        WorkError: if another process is running this evaluation, or it can't be written.
    """
    named = name or settings.policy
    is_accepted = settings.accepted is not None
    policy = find_policy(results, named, settings.task, settings.seed, is_accepted)
    code = evaluation_code(settings.task, named)
    task = find_task(settings.task)
    if settings.states and not task.records_states:
        raise RequestError(
            f"States are recorded of the Jitterbug only, not of {settings.task}: leave --states "
            "out."
        )
    if settings.target_yaw is not None and "yaw" not in task.drawn:
        raise RequestError(
            f"--target-yaw is for tasks with a target direction, not for {settings.task}: leave it "
            "out."
        )

    with results.locked("evaluation", settings.id) as existing:
        if existing is not None and existing.is_finished:
            return existing
        record = results.create("evaluation", settings.id, settings.model_dump(), code)
        for first in range(0, settings.episodes, _TOGETHER):
            episodes = range(first, min(first + _TOGETHER, settings.episodes))
            policy.reset(len(episodes))
            with task.worlds(len(episodes), threads, settings.augment) as worlds:
                record.append(_episodes(settings, episodes, worlds, policy.act, progress))
                for error in worlds.failures.values():
                    record.fail(str(error), error.summary)
                    raise error.with_clause(_kept(settings, record)) from error

        returns = record.read("policy_episodes")["episode_return"].to_numpy()
        q10, median, q90 = np.percentile(returns, (10, 50, 90))
        summary = {"mean": returns.mean(), "median": median, "q10": q10, "q90": q90}
        record.finish(summary, join=False)

    return record


def _kept(settings: EvaluationSettings, record: Record) -> str:
    """Returns what a failed evaluation has kept, and what to type, as clauses."""
    kept = f"{record.rows('policy_episodes'):,} of {counted(settings.episodes, 'episode')}"
    if fails_by_numbers(record.manifest.summary):
        return f"{kept} are kept, and --seed {settings.seed + 1} makes other ones"
    return f"{kept} are kept, and the same command makes all of them again"


def _episodes(
    settings: EvaluationSettings, episodes: range, worlds: Worlds, act: Act, progress: _Progress
) -> dict[str, pa.Table]:
    """Returns the rows of some episodes that are stepped side by side."""
    generators = [episode_generator(settings.seed, episode) for episode in episodes]
    chosen = {}
    if settings.target_yaw is not None:
        chosen["yaw"] = np.full(len(episodes), settings.target_yaw)

    observations = worlds.reset(generators, chosen)
    unknown = [None] * len(episodes)
    targets = worlds.targets()
    target = {f"target_{name}": targets.get(name, unknown) for name in ("x", "y", "yaw")}
    total = np.zeros(len(episodes))
    states: list[pa.Table] = []
    for step, transition in enumerate(rollout(worlds, observations, act), 1):
        total += transition.rewards
        if settings.states:
            columns = {
                "episode": np.arange(episodes.start, episodes.stop),
                "step": np.full(len(episodes), step),
                **worlds.robot_columns(),
                "action": transition.actions[:, 0].astype(np.float32),
                "reward": transition.rewards.astype(np.float32),
            }
            states.append(pa.table(columns, schema=schema.FILES["policy_states"]))

        if step % 100 == 0:
            progress(episodes.start * settings.episode_steps + step * len(episodes))

    lengths = np.broadcast_to(worlds.lengths(), len(episodes))
    rows = {
        "evaluation": [settings.id] * len(episodes),
        "episode": list(episodes),
        "episode_return": total,
        "length": lengths,
        **target,
    }
    ended = [world not in worlds.failures for world in range(len(episodes))]
    columns = pa.table(rows, schema=schema.TABLES["policy_episodes"])
    tables = {"policy_episodes": columns.filter(pa.array(ended))}
    if states:
        tables["policy_states"] = pa.concat_tables(states).combine_chunks()

    return tables
