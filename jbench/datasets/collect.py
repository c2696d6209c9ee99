"""Collecting a random-policy dataset, one simulation for all five tasks."""

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
from jbench.settings.dataset import DatasetSettings
from jbench.simulation import simulate
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
    first = record.rows("dataset_episodes")
    starts = range(first, total, _PART_EPISODES)
    progress(first * EPISODE_STEPS)
    model = load_model(settings.augment)
    # Enough files to keep all threads busy while one file is written.
    max_files = 1 + math.ceil(threads / _PART_EPISODES)
    # The pools are closed in reverse order: simulations stop before the makers that wait for them.
    with _pool(max_files) as makers, _pool(threads) as simulators:

        def make(start: int) -> dict[str, pa.Table]:
            episodes = range(start, min(start + _PART_EPISODES, total))
            return _part(model, settings.seed, episodes, simulators)

        ahead = deque(makers.submit(make, start) for start in starts[:max_files])
        for start in starts[max_files:]:
            tables = ahead.popleft().result()
            ahead.append(makers.submit(make, start))
            _commit(record, tables, progress)
        for part in ahead:
            _commit(record, part.result(), progress)


def _commit(
    record: Record, tables: Mapping[str, pa.Table], progress: Callable[[int], None]
) -> None:
    record.append(tables)
    progress(record.rows("dataset_episodes") * EPISODE_STEPS)


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
