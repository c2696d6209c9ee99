"""Datasets of the Jitterbug: states and actions, and per episode the targets of every task.

The robot does not know the target, so one simulation serves all tasks: their observations and
rewards are computed when a dataset is read.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.datasets import fixed
from jbench.datasets.block import Block
from jbench.datasets.fixed import Part, Simulate, SimulatedSteps, collect_fixed
from jbench.datasets.layout import DatasetLayout
from jbench.datasets.rows import table
from jbench.names import TASKS
from jbench.settings.records import DatasetSettings
from jbench.store import Record, schema
from jbench.tasks.jitterbug import features, resets, rewards
from jbench.tasks.jitterbug.geometry import TARGET_HEIGHT, State, Target
from jbench.tasks.jitterbug.robots import load_model
from jbench.tasks.jitterbug.simulation import Robots
from jbench.tasks.task import episode_generator


class JitterbugLayout(DatasetLayout):
    """States, from which each of the five tasks has its observations."""

    step_table = "steps"
    episode_table = "dataset_episodes"
    task = "face_direction"
    ends_early = False

    def collect(
        self,
        settings: DatasetSettings,
        record: Record,
        threads: int,
        progress: Callable[[int], None],
    ) -> None:
        """Collects with enough files at once to keep all threads busy while one is written."""
        max_files = 1 + math.ceil(threads / fixed.PART_EPISODES)
        simulation = _simulation(settings, threads)
        collect_fixed(settings, record, self.episode_table, simulation, max_files, progress)

    def columns(self, task: str) -> tuple[pa.Schema, pa.Schema]:
        """Returns the columns of the states, and of the targets of all tasks."""
        return schema.STEPS, schema.DATASET_EPISODES

    def block(
        self, task: str, step_rows: pa.Table, episode_rows: pa.Table, episode_steps: int
    ) -> Block:
        """Computes the observations and rewards of a task."""
        state = read_state(step_rows, episode_steps)
        target = read_target(task, episode_rows, episode_steps + 1)
        return Block.truncated(
            features.observation(task, state, target),
            step_rows["action"].to_numpy().reshape(-1, episode_steps + 1)[:, :-1],
            rewards.reward(task, state, target)[:, 1:],
        )

    def minari_id(self, dataset: str, task: str) -> str:
        """Returns an id such as jitterbug/face_direction/random-s00-1f9a2c4e-v0."""
        return f"jitterbug/{task}/{dataset.replace('/', '-')}-v0"


@contextmanager
def _simulation(settings: DatasetSettings, threads: int) -> Iterator[Simulate]:
    """Yields a function that simulates some episodes of the Jitterbug, side by side."""
    model = load_model(settings.augment)

    def simulate_part(episodes: range, simulated: SimulatedSteps) -> Part:
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
            states.append(robots.step(commands))
            simulated.count(len(episodes))

        state = State(*(np.stack(part, axis=1) for part in zip(*states, strict=True)))
        return Part(
            {
                JitterbugLayout.step_table: steps_table(episodes.start, state, stacked),
                JitterbugLayout.episode_table: pa.Table.from_pylist(rows, schema.DATASET_EPISODES),
            }
        )

    yield simulate_part


def steps_table(first_episode: int, state: State, actions: NDArray[np.float32]) -> pa.Table:
    """Returns the rows of episodes: states (episodes, steps + 1), actions (episodes, steps)."""
    parts = (
        np.reshape(getattr(state, part), (*state.motor_position.shape, len(names)))
        for part, names in schema.STATE_COLUMNS.items()
    )
    states = np.concatenate([part.astype(np.float32) for part in parts], axis=-1)
    return table(first_episode, states, actions[..., None], schema.STEPS)


def read_state(rows: pa.Table, episode_steps: int) -> State:
    """Returns the states (episodes, steps + 1) of rows of whole episodes, in float32."""
    parts = {}
    for part, names in schema.STATE_COLUMNS.items():
        columns = [rows[name].to_numpy().reshape(-1, episode_steps + 1) for name in names]
        parts[part] = np.stack(columns, -1) if len(names) > 1 else columns[0]
    return State(**parts)


def read_target(task: str, rows: pa.Table, states: int) -> Target:
    """Returns the targets (episodes, states) of a task, in float32."""
    x, y, yaw = (
        np.broadcast_to(column.to_numpy().astype(np.float32)[:, None], (len(rows), states))
        for column in (rows[f"{task}_target_{part}"] for part in ("x", "y", "yaw"))
    )
    return Target(np.stack([x, y, np.full_like(x, TARGET_HEIGHT)], -1), yaw)
