"""Collecting a random-policy dataset: one simulation for all five tasks, or of another robot."""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyarrow as pa

from jbench.datasets import layout
from jbench.names import EPISODE_STEPS, TASKS
from jbench.settings.dataset import JITTERBUG, DatasetSettings
from jbench.simulation import Task, Worlds, find_task, simulate
from jbench.store import Record, Results
from jbench.tasks import model as robot
from jbench.tasks import resets
from jbench.tasks.robots import load_model

# Episodes per file and commit.
_PART_EPISODES = 25


def collect(
    settings: DatasetSettings,
    results: Results,
    threads: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> Record:
    """Collects a dataset, resumes its collection, or returns the finished one.

    The actions are uniform in [-1, 1] (paper, section 5.2). Every episode has its own generator, so
    the dataset does not depend on threads or interruptions.

    Args:
        progress: called with the number of completed control steps.

    Raises:
        RequestError: if its robot is not installed or has changed.
        WorkError: if another process collects it, or the disk is full.
    """
    with results.locked("dataset", settings.id) as existing:
        if existing is not None and existing.status == "finished":
            return existing
        record = existing or results.create("dataset", settings.id, settings.model_dump())
        _collect_rest(settings, record, threads, progress)
        record.finish({}, compact=False)
    return record


def _collect_rest(
    settings: DatasetSettings, record: Record, threads: int, progress: Callable[[int], None]
) -> None:
    """Simulates and commits the missing episodes, file by file.

    The next files are simulated while one is written.
    """
    total = settings.steps // EPISODE_STEPS
    _, of_episodes = layout.tables(settings.robot)
    first = record.rows(of_episodes)
    starts = range(first, total, _PART_EPISODES)
    progress(first * EPISODE_STEPS)
    is_jitterbug = settings.robot == JITTERBUG
    task, model = find_task(TASKS[0] if is_jitterbug else settings.robot), None
    if is_jitterbug:
        model = load_model(settings.augment)
    # Enough files to keep all threads busy while one file is written. Others are made in one.
    max_files = 1 + math.ceil(threads / _PART_EPISODES) if is_jitterbug else 1

    def commit(tables: Mapping[str, pa.Table]) -> None:
        record.append(tables)
        progress(record.rows(of_episodes) * EPISODE_STEPS)

    # The pools are closed in reverse order: simulations stop before the makers that wait for them.
    with _pool(max_files) as makers, _pool(threads) as simulators, task.worlds(1) as worlds:

        def make(start: int) -> dict[str, pa.Table]:
            episodes = range(start, min(start + _PART_EPISODES, total))
            if model is None:
                return _part_of_task(task, worlds, settings.seed, episodes)
            return _part(model, settings.seed, episodes, simulators)

        ahead = deque(makers.submit(make, start) for start in starts[:max_files])
        for start in starts[max_files:]:
            tables = ahead.popleft().result()
            ahead.append(makers.submit(make, start))
            commit(tables)
        for part in ahead:
            commit(part.result())


@contextmanager
def _pool(threads: int) -> Iterator[ThreadPoolExecutor]:
    """Yields a thread pool; pending work is canceled at the end of the block."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _part(
    model: Any, seed: int, episodes: range, simulators: ThreadPoolExecutor
) -> dict[str, pa.Table]:
    """Simulates some episodes and returns their rows."""
    quaternions, targets, actions = [], [], []
    for episode in episodes:
        random = resets.episode_generator(seed, episode)
        quaternions.append(resets.draw_quaternion(random))
        targets.append({task: resets.draw_target(task, random) for task in TASKS})
        actions.append(random.uniform(-1, 1, EPISODE_STEPS).astype(np.float32))
    stacked = np.stack(actions)
    trajectories = simulate(model, np.stack(quaternions), stacked, simulators)
    state = robot.state_of(*trajectories, robot.torso_offset(model))
    return {
        "steps": layout.steps_table(episodes.start, state, stacked),
        "dataset_episodes": layout.episodes_table(episodes.start, targets),
    }


def _part_of_task(task: Task, worlds: Worlds, seed: int, episodes: range) -> dict[str, pa.Table]:
    """Steps some episodes of another robot, one after another, and returns their rows."""
    count = len(episodes)
    observations = np.empty((count, EPISODE_STEPS + 1, task.observation_size), np.float32)
    actions = np.empty((count, EPISODE_STEPS, task.action_size), np.float32)
    rewards, seeds = np.empty((count, EPISODE_STEPS), np.float32), np.empty(count, np.int64)
    for i, episode in enumerate(episodes):
        random = resets.episode_generator(seed, episode)
        (observations[i, 0],) = worlds.reset([random])
        (seeds[i],) = worlds.state(slice(0, 1))["seeds"]
        actions[i] = random.uniform(-1, 1, actions[i].shape)
        for step, action in enumerate(actions[i]):
            (observations[i, step + 1],), (rewards[i, step],) = worlds.step(action[None])
    columns = {"episode": list(episodes), "seed": seeds}
    names = layout.tables(task.name)
    steps = layout.observations_table(task, episodes.start, observations, actions, rewards)
    return {names[0]: steps, names[1]: pa.table(columns, schema=layout.SEEDS)}
