"""Collecting a random-policy dataset: one simulation for all five tasks, or of another robot."""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from threading import Event
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from jbench.datasets import layout
from jbench.datasets.collect_ending import collect_ending
from jbench.names import TASKS
from jbench.settings.records import JITTERBUG, DatasetSettings
from jbench.store import Record, Results
from jbench.store.code import check_code
from jbench.store.planned import Planned, planned
from jbench.store.schema import DATASET_EPISODES
from jbench.tasks.find import check_specs, code_provenance, episode_provenance, find_task
from jbench.tasks.jitterbug import resets
from jbench.tasks.jitterbug.geometry import State
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots
from jbench.tasks.task import episode_generator
from jbench.tasks.worlds import EpisodeError

_PART_EPISODES = 10  # per file and commit
_REPORT_SECONDS = 0.5  # between two reports of progress


class _Part(NamedTuple):
    """Tables of some episodes; `failure` is the error of the next one, which can't go on."""

    tables: dict[str, pa.Table]
    failure: EpisodeError | None = None


class _Steps:
    """The control steps of a file that have been simulated; written by one thread."""

    done = 0


_Simulate = Callable[[range, _Steps], _Part]


def plan_dataset(settings: DatasetSettings, results: Results) -> Planned:
    """Returns settings with the id of a recorded dataset of the same code, if there is one."""
    if settings.robot == JITTERBUG:
        return Planned(settings, [])
    now = code_provenance(settings.robot)
    return planned(settings, results.scan("dataset")[0], now, ("seed", "steps"))


def collect(
    settings: DatasetSettings,
    results: Results,
    threads: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> Record:
    """Collects a dataset, resumes its collection, or returns the finished one.

    The actions are uniform in [-1, 1] (paper, section 5.2). Every episode has its own generator, so
    the dataset does not depend on threads or interruptions. It is committed file by file, and the
    next ones are simulated while one is written. `progress` takes the control steps that are
    committed or simulated, at least each second. Raises a RequestError if its robot is not
    installed or has changed, and a WorkError if another process collects it, or the disk is full.
    """
    with results.locked("dataset", settings.id) as existing:
        if existing is not None and existing.status == "finished":
            return existing
        code = {} if settings.robot == JITTERBUG else code_provenance(settings.robot)
        if existing is not None:
            check_code(existing, code)
        if existing is None:
            made_on = {} if settings.robot == JITTERBUG else episode_provenance(settings.robot)
            record = results.create(
                "dataset", settings.id, settings.model_dump(), {**made_on, **code}
            )
        else:
            record = existing
        if settings.robot != JITTERBUG and find_task(settings.robot).ends_early:
            collect_ending(settings, record, progress)
            record.finish({}, compact=False)
            return record
        total = settings.steps // settings.episode_steps
        _, episodes = layout.tables(settings.robot)
        first = record.rows(episodes)
        starts = range(first, total, _PART_EPISODES)
        parts = [range(start, min(start + _PART_EPISODES, total)) for start in starts]
        progress(first * settings.episode_steps)
        if settings.robot == JITTERBUG:
            # Enough files to keep all threads busy while one file is written.
            max_files = 1 + math.ceil(threads / _PART_EPISODES)
            simulation = _jitterbug
        else:
            max_files = 1
            simulation = _other_robot

        # Closed in reverse order: simulations stop before the pool waits for them.
        with ThreadPoolExecutor(max_files) as makers, simulation(settings, threads) as simulated:
            for made, ahead in _in_order(makers, simulated, parts, max_files):
                if made is not None:
                    record.append(made.tables)
                    if made.failure is not None:
                        raise made.failure

                progress(record.rows(episodes) * settings.episode_steps + ahead)

        record.finish({}, compact=False)

    return record


def _in_order(
    makers: ThreadPoolExecutor, simulated: _Simulate, parts: Sequence[range], max_files: int
) -> Iterator[tuple[_Part | None, int]]:
    """Yields the part of each file, and the control steps that are simulated beyond it.

    While a file is simulated, None takes the place of its part, at least each second.
    """
    waiting = iter(parts)
    ahead = deque[tuple[Future[_Part], _Steps]]()

    def submit(files: int) -> None:
        for part in itertools.islice(waiting, files):
            steps = _Steps()
            ahead.append((makers.submit(simulated, part, steps), steps))

    submit(max_files)

    while ahead:
        first, _ = ahead[0]
        while not wait([first], _REPORT_SECONDS).done:
            yield None, sum(steps.done for _, steps in ahead)
        ahead.popleft()
        submit(1)
        yield first.result(), sum(steps.done for _, steps in ahead)


@contextmanager
def _jitterbug(settings: DatasetSettings, threads: int) -> Iterator[_Simulate]:
    """Yields a function that simulates some episodes of the Jitterbug, side by side."""
    model = load_model(settings.augment)
    ended = Event()

    def simulate_part(episodes: range, simulated: _Steps) -> _Part:
        quaternions = []
        rows = list[dict[str, Any]]()
        actions = []
        for episode in episodes:
            random = episode_generator(settings.seed, episode)
            quaternions.append(resets.draw_quaternion(random))
            rows.append({"episode": episode})
            for task in TASKS:
                (x, y, _), yaw = resets.draw_target(task, random)
                rows[-1][f"{task}_target_x"] = x
                rows[-1][f"{task}_target_y"] = y
                rows[-1][f"{task}_target_yaw"] = yaw

            actions.append(random.uniform(-1, 1, settings.episode_steps).astype(np.float32))

        stacked = np.stack(actions)
        robots = Robots(model, len(episodes), threads)
        states = [robots.reset(np.stack(quaternions))]
        for commands in stacked.T:
            if ended.is_set():
                raise CancelledError
            states.append(robots.step(commands))
            simulated.done += len(episodes)

        state = State(*(np.stack(part, axis=1) for part in zip(*states, strict=True)))
        return _Part(
            {
                "steps": layout.steps_table(episodes.start, state, stacked),
                "dataset_episodes": pa.Table.from_pylist(rows, DATASET_EPISODES),
            }
        )

    try:
        yield simulate_part
    finally:
        ended.set()


@contextmanager
def _other_robot(settings: DatasetSettings, threads: int) -> Iterator[_Simulate]:
    """Yields a function that simulates some episodes of another robot, one after the other."""
    check_specs(settings.robot, settings.specs)
    task = find_task(settings.robot)

    def simulate_part(episodes: range, simulated: _Steps) -> _Part:
        failure: EpisodeError | None = None
        count = len(episodes)
        length = settings.episode_steps
        observations = np.empty((count, length + 1, task.observation_size), np.float32)
        made = np.empty((count, length, task.action_size + 1), np.float32)
        actions = made[..., :-1]
        rewards = made[..., -1]
        seeds = np.empty(count, np.int64)
        for i, episode in enumerate(episodes):
            random = episode_generator(settings.seed, episode)
            (observations[i, 0],) = worlds.reset([random])
            (seeds[i],) = worlds.state(slice(0, 1))["seeds"]
            actions[i] = random.uniform(-1, 1, actions[i].shape)
            for step, action in enumerate(actions[i]):
                (observations[i, step + 1],), (rewards[i, step],) = worlds.step(action[None])
                simulated.done += 1
            if worlds.failures:
                failure = worlds.failures[0]
                episodes = episodes[:i]
                break

        ended = len(episodes)
        columns = {"episode": list(episodes), "seed": seeds[:ended]}
        names = layout.tables(task.name)
        schema = layout.observations_schema(task)
        steps = layout.table(episodes.start, observations[:ended], made[:ended], schema)
        tables = {names[0]: steps, names[1]: pa.table(columns, schema=layout.SEEDS)}
        return _Part(tables, failure)

    with task.worlds(1) as worlds:
        yield simulate_part
