"""Collecting a random-policy dataset of a robot whose episodes may end early."""

import contextlib
from collections.abc import Callable

import numpy as np
import pyarrow as pa

from jbench.array_types import Float32Array
from jbench.datasets.observations import (
    EPISODE_COLUMNS,
    EPISODE_TABLE,
    STEP_TABLE,
    observations_schema,
)
from jbench.datasets.rows import Episode, ending_table
from jbench.settings.records import DatasetSettings
from jbench.store import Record
from jbench.tasks.find import check_specs, find_task
from jbench.tasks.task import Task, episode_generator
from jbench.tasks.worlds import EpisodeError, Worlds

_PART_STEPS = 10_000  # control steps per file and commit


def collect_ending(
    settings: DatasetSettings, record: Record, progress: Callable[[int], None]
) -> None:
    """Collects episodes until they have the control steps of the settings, or resumes that.

    The actions are uniform in [-1, 1], every episode has its own generator, and the last one is
    truncated where the steps are complete. Raises a RequestError if the robot has changed, and an
    EpisodeError if an episode can't go on; those before it are kept.
    """
    check_specs(settings.robot, settings.specs)
    task = find_task(settings.robot)
    with contextlib.closing(task.worlds(1)) as worlds:
        while _steps_in(record) < settings.steps:
            first = record.rows(EPISODE_TABLE)
            part, failure = _part(settings, worlds, first, _steps_in(record), progress)
            if part:
                record.append(_tables(task, first, part))
            if failure is not None:
                raise failure


def _steps_in(record: Record) -> int:
    """Returns the control steps of a dataset; an episode has one row more than these."""
    return record.rows(STEP_TABLE) - record.rows(EPISODE_TABLE)


def _part(
    settings: DatasetSettings,
    worlds: Worlds,
    first: int,
    done: int,
    progress: Callable[[int], None],
) -> tuple[list[Episode], EpisodeError | None]:
    """Returns the episodes of a file, and the error of the next one if that can't go on."""
    part: list[Episode] = []
    end = min(done + _PART_STEPS, settings.steps)
    progress(done)
    while done < end:
        random = episode_generator(settings.seed, first + len(part))
        episode = _episode(settings, worlds, random, settings.steps - done)
        if worlds.failures:
            return part, worlds.failures[0]
        part.append(episode)
        done += len(episode.rewards)
        progress(done)

    return part, None


def _episode(
    settings: DatasetSettings, worlds: Worlds, random: np.random.Generator, most: int
) -> Episode:
    """Returns an episode of random actions in one world, of `most` control steps or fewer."""
    size = find_task(settings.robot).action_size
    observations = [worlds.reset([random])[0]]
    (seed,) = worlds.state(slice(0, 1))["seeds"].tolist()
    actions: list[Float32Array] = []
    rewards: list[float] = []
    # One at a time, since an episode may be much shorter than its time limit.
    while len(actions) < most and not worlds.are_over():
        action = random.uniform(-1, 1, size).astype(np.float32)
        (observation,), (reward,) = worlds.step(action[None])
        actions.append(action)
        observations.append(observation)
        rewards.append(reward)

    return Episode(
        seed=seed,
        observations=np.stack(observations),
        actions=np.reshape(actions, (len(actions), size)),
        rewards=np.array(rewards, np.float32),
        is_terminated=bool(worlds.terminated[0]),
    )


def _tables(task: Task, first: int, part: list[Episode]) -> dict[str, pa.Table]:
    """Returns the rows of episodes, the first of which has the number `first`."""
    numbers = list(range(first, first + len(part)))
    columns = {"episode": numbers, "seed": [episode.seed for episode in part]}
    return {
        STEP_TABLE: ending_table(first, part, observations_schema(task)),
        EPISODE_TABLE: pa.table(columns, schema=EPISODE_COLUMNS),
    }
