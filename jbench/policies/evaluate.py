"""Evaluates any policy and saves its returns, and on request every state."""

from collections.abc import Callable, Iterator

import numpy as np
import pyarrow as pa

from jbench.names import EPISODE_STEPS
from jbench.policies.find import find_policy
from jbench.settings.evaluation import EvaluationSettings
from jbench.simulation import Act, Robots, Transition, rollout
from jbench.store import Record, Results, schema
from jbench.tasks import features, resets, rewards
from jbench.tasks.resets import Starts
from jbench.tasks.robots import load_model

# Robots stepped together: enough for the threads, and few enough for little memory.
_TOGETHER = 50


def evaluate(
    settings: EvaluationSettings,
    results: Results,
    threads: int,
    progress: Callable[[int], None] = lambda steps: None,
    name: str | None = None,
) -> Record:
    """Runs and saves the episodes of a policy, unless they have been saved before.

    Each episode has its own generator for pose and target. The random policy is seeded; all others
    are deterministic.

    Args:
        results: where it is written; contains the runs.
        threads: number of robots stepped in parallel.
        progress: called with the number of control steps done, over all episodes.
        name: of the policy, such as a path; None for that of the settings.

    Raises:
        RequestError: if there is no such policy for this task.
        WorkError: if another process is running this evaluation, or it can't be written.
    """
    policy = find_policy(results, name or settings.policy, settings.task, settings.seed)
    with results.locked("evaluation", settings.id) as existing:
        if existing is not None and existing.status == "finished":
            return existing
        record = results.create("evaluation", settings.id, settings.model_dump())
        model = load_model(settings.augment)
        for first in range(0, settings.episodes, _TOGETHER):
            episodes = range(first, min(first + _TOGETHER, settings.episodes))
            with Robots(model, len(episodes), threads) as robots:
                policy.reset(len(episodes))
                tables = _episodes(settings, episodes, robots, policy.act, progress)
            record.append(tables)
        returns = record.read("policy_episodes")["episode_return"]
        q10, median, q90 = np.percentile(returns.to_numpy(), (10, 50, 90))
        record.finish({"median": median, "q10": q10, "q90": q90}, compact=False)
    return record


def _episodes(
    settings: EvaluationSettings,
    episodes: range,
    robots: Robots,
    act: Act,
    progress: Callable[[int], None],
) -> dict[str, pa.Table]:
    """Runs episodes in parallel; returns their rows."""
    starts = _starts(settings, episodes)
    target = starts.targets
    total = np.zeros(len(episodes))
    transitions: list[tuple[int, Transition]] = []
    for step, transition in enumerate(rollout(settings.task, robots, starts, act), 1):
        total += transition.rewards
        if settings.states:
            transitions.append((step, transition))
        if step % 100 == 0:
            progress(episodes.start * EPISODE_STEPS + step * len(episodes))
    rows = {
        "evaluation": [settings.id] * len(episodes),
        "episode": list(episodes),
        "episode_return": total,
        "length": [EPISODE_STEPS] * len(episodes),
        "target_x": target.position[:, 0],
        "target_y": target.position[:, 1],
        "target_yaw": target.yaw,
    }
    tables = {"policy_episodes": pa.table(rows, schema=schema.POLICY_EPISODES)}
    if settings.states:
        tables["policy_states"] = _states_table(episodes, transitions)
    return tables


def _starts(settings: EvaluationSettings, episodes: range) -> Starts:
    """Returns the initial poses and targets of the episodes."""
    generators = [resets.episode_generator(settings.seed, episode) for episode in episodes]
    starts = resets.draw_starts(settings.task, generators)
    if settings.target_yaw is None:
        return starts
    yaw = np.full(len(episodes), settings.target_yaw)
    return starts._replace(targets=starts.targets._replace(yaw=yaw))


def _states_table(episodes: range, transitions: list[tuple[int, Transition]]) -> pa.Table:
    """Returns one row per episode and step."""

    def parts() -> Iterator[pa.Table]:
        for step, (_, action, state, reward, _) in transitions:
            x, y, z = (state.position[:, i].astype(np.float32) for i in range(3))
            yield pa.table(
                {
                    "episode": np.arange(episodes.start, episodes.stop),
                    "step": np.full(len(episodes), step),
                    "x": x,
                    "y": y,
                    "z": z,
                    "heading": features.heading(state).astype(np.float32),
                    "upright": rewards.upright_reward(state).astype(np.float32),
                    "motor_position": state.motor_position.astype(np.float32),
                    "motor_velocity": state.motor_velocity.astype(np.float32),
                    "action": action.astype(np.float32),
                    "reward": reward.astype(np.float32),
                },
                schema=schema.POLICY_STATES,
            )

    return pa.concat_tables(parts()).combine_chunks()
