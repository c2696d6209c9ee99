"""Collecting a random-policy dataset: one simulation that serves all five tasks."""

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

# Episodes in one file: what is committed at a time, and what is in memory.
_PART_EPISODES = 25


def collect(
    settings: DatasetSettings,
    results: Results,
    threads: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> Record:
    """Collects a dataset, or continues one, or finds it finished.

    The actions are uniform in [-1, 1] (paper, section 5.2). Every episode draws from a generator
    of its own, so that neither threads nor interruptions change a byte of the dataset.

    Args:
        settings: of the dataset.
        results: where it goes.
        threads: how many episodes are simulated at a time.
        progress: called with the number of control steps done so far.

    Raises:
        WorkError: if another process collects it, or the disk is full.
    """
    with results.hold("dataset", settings.id) as found:
        if found is not None and found.status == "finished":
            return found
        record = found or results.create("dataset", settings.id, settings.model_dump())
        _collect_rest(settings, record, threads, progress)
        record.finish({}, compact=False)
    return record


def _collect_rest(
    settings: DatasetSettings, record: Record, threads: int, progress: Callable[[int], None]
) -> None:
    """Simulates and commits what is missing, file by file.

    While one file is written the next ones are simulated: the simulating threads always have
    episodes to go on with.
    """
    total = settings.steps // EPISODE_STEPS
    first = record.rows("dataset_episodes")
    starts = range(first, total, _PART_EPISODES)
    progress(first * EPISODE_STEPS)
    model = robot.load(settings.augment)
    # Enough files at a time that, with one of them being written, no thread lacks an episode.
    at_a_time = 1 + math.ceil(threads / _PART_EPISODES)
    # Left in the opposite order: who waits for simulations is not waited for before they stop.
    with _pool(at_a_time) as makers, _pool(threads) as simulators:

        def make(start: int) -> dict[str, pa.Table]:
            episodes = range(start, min(start + _PART_EPISODES, total))
            return _part(model, settings.seed, episodes, simulators)

        ahead = deque(makers.submit(make, start) for start in starts[:at_a_time])
        for start in starts[at_a_time:]:
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
    """Gives threads; where the work is stopped, what has not begun is not waited for."""
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
    held = np.stack(actions)
    trajectories = simulate(model, np.stack(quaternions), held, simulators)
    state = robot.state_of(*trajectories, robot.torso_offset(model))
    return {
        "steps": layout.steps_table(episodes.start, state, held),
        "dataset_episodes": layout.episodes_table(episodes.start, targets),
    }
