"""Datasets of other robots: observations, actions and rewards, and per episode its seed."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyarrow as pa

from jbench.datasets import rows
from jbench.datasets.block import Block
from jbench.datasets.collect_ending import collect_ending
from jbench.datasets.fixed import Part, Simulate, SimulatedSteps, collect_fixed
from jbench.datasets.layout import DatasetLayout
from jbench.datasets.observations import (
    EPISODE_COLUMNS,
    EPISODE_TABLE,
    STEP_TABLE,
    observations_schema,
)
from jbench.errors import RequestError
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.store.planned import Planned, planned
from jbench.tasks.find import check_specs, episode_provenance, find_task, task_provenance
from jbench.tasks.task import episode_generator
from jbench.tasks.worlds import EpisodeError


class OtherLayout(DatasetLayout):
    """Observations and rewards as the task of another robot has returned them."""

    step_table = STEP_TABLE
    episode_table = EPISODE_TABLE

    def __init__(self, task: str) -> None:
        """A dataset of another robot is of one task, which may not be installed here."""
        self.task = task
        self.option = f" --task {task}"
        self.of_robot = f" of {task}"

    @property
    def ends_early(self) -> bool:
        """Whether episodes of the task may end before the time limit."""
        return find_task(self.task).ends_early

    def code(self) -> dict[str, Any]:
        """Returns the provenance of the task's code."""
        return task_provenance(self.task)

    def notes(self) -> dict[str, Any]:
        """Returns whether the task's episodes do not repeat."""
        return episode_provenance(self.task)

    def plan(self, settings: DatasetSettings, results: Results) -> Planned[DatasetSettings]:
        """Returns settings with the id of a recorded dataset of the same code, if there is one.

        Raises a RequestError if they are of an augmented robot, which only the Jitterbug has.
        """
        if settings.augment is not None:
            raise RequestError(f"{self.task} has no augmented robots: leave --augment out.")

        return planned(settings, results.scan("dataset")[0], self.code(), ("seed", "steps"))

    def collect(
        self,
        settings: DatasetSettings,
        record: Record,
        threads: int,
        progress: Callable[[int], None],
    ) -> None:
        """Collects one file at a time, since an environment is stepped by one thread."""
        if self.ends_early:
            collect_ending(settings, record, progress)
            return

        simulation = _simulation(settings)
        collect_fixed(settings, record, self.episode_table, simulation, 1, progress)

    def columns(self, task: str) -> tuple[pa.Schema, pa.Schema]:
        """Returns the columns of the observations, and of the seeds."""
        return observations_schema(find_task(task)), EPISODE_COLUMNS

    def block(
        self, task: str, step_rows: pa.Table, episode_rows: pa.Table, episode_steps: int
    ) -> Block:
        """Splits the rows into observations, actions and rewards."""
        return rows.block(step_rows, find_task(task).observation_size)

    def minari_id(self, dataset: str, task: str) -> str:
        """Returns an id such as jbench/dmc-cheetah-run/random-s00-59ba1e20-v0."""
        robot, _, name = dataset.partition("/")
        return f"jbench/{robot.replace('.', '-')}/{name.replace('/', '-')}-v0"


@contextmanager
def _simulation(settings: DatasetSettings) -> Iterator[Simulate]:
    """Yields a function that simulates some episodes of another robot, one after the other."""
    check_specs(settings.robot, settings.specs)
    task = find_task(settings.robot)

    def simulate_part(episodes: range, simulated: SimulatedSteps) -> Part:
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
                simulated.count(1)
            if worlds.failures:
                failure = worlds.failures[0]
                episodes = episodes[:i]
                break

        ended = len(episodes)
        columns = {"episode": list(episodes), "seed": seeds[:ended]}
        schema = observations_schema(task)
        steps = rows.table(episodes.start, observations[:ended], made[:ended], schema)
        return Part(
            {STEP_TABLE: steps, EPISODE_TABLE: pa.table(columns, schema=EPISODE_COLUMNS)}, failure
        )

    with task.worlds(1) as worlds:
        yield simulate_part
