"""What the datasets of a robot are like: their tables, how they are collected and read.

Steps are rows of whole episodes, each a state and the action that follows it; the last state of an
episode has no action. Another table has a row for each episode.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.store.planned import Planned

Float = NDArray[np.float32]


class Block(NamedTuple):
    """Episodes of n control steps with the observations and rewards of one task, in float32.

    Attributes:
        observations: (episodes, n + 1, dim(O)), the last after the last action.
        actions: (episodes, n) of the Jitterbug, whose actions are numbers; of another robot as
            `action_vectors`.
        rewards: (episodes, n), at the end of each control step.
    """

    observations: Float
    actions: Float
    rewards: Float

    @property
    def states(self) -> Float:
        """The observations, as `EndingBlock` has them."""
        return self.observations

    @property
    def action_vectors(self) -> Float:
        """The actions of any robot, (episodes, n, action_size)."""
        return self.actions if self.actions.ndim == 3 else self.actions[..., None]


class DatasetLayout(ABC):
    """The datasets of a robot; `by_robot.find_layout` has that of a name.

    Attributes:
        steps: name of the table of states and actions.
        episodes: name of the table with a row for each episode.
        task: the one whose observations are read if no other is named.
        option: what names the robot in a command line, with a space before it.
        of_robot: the same in a sentence.
    """

    steps: ClassVar[str]
    episodes: ClassVar[str]
    task: str
    option: str = ""
    of_robot: str = ""

    def control_steps(self, record: Record) -> int:
        """Returns the control steps of the committed episodes of a dataset."""
        # An episode has one row more than control steps.
        return record.rows(self.steps) - record.rows(self.episodes)

    @property
    @abstractmethod
    def ends_early(self) -> bool:
        """Whether episodes may end before the time limit."""

    def code(self) -> dict[str, Any]:
        """Returns the provenance of the robot's code, if it is not jbench's."""
        return {}

    def notes(self) -> dict[str, Any]:
        """Returns what records note of the robot, see `tasks.find.episode_provenance`."""
        return {}

    def plan(self, settings: DatasetSettings, results: Results) -> Planned[DatasetSettings]:
        """Returns settings with the id of a recorded dataset of the same code, if there is one."""
        return Planned(settings, [])

    @abstractmethod
    def collect(
        self,
        settings: DatasetSettings,
        record: Record,
        threads: int,
        progress: Callable[[int], None],
    ) -> None:
        """Collects the episodes that a dataset lacks; see `jbench.datasets.collect`."""

    @abstractmethod
    def columns(self, task: str) -> tuple[pa.Schema, pa.Schema]:
        """Returns the columns of both tables that the observations of a task need."""

    @abstractmethod
    def flaw(
        self, steps: pa.Table, episodes: pa.Table, part: range, episode_steps: int
    ) -> str | None:
        """Returns a problem of the rows of some episodes, to follow "holds"; None if valid."""

    @abstractmethod
    def block(self, task: str, steps: pa.Table, episodes: pa.Table, episode_steps: int) -> Block:
        """Returns observations and rewards of a task from the rows of episodes of one length."""

    @abstractmethod
    def minari_id(self, dataset: str, task: str) -> str:
        """Returns Minari's id of the dataset with an id, with the observations of a task."""


def table(first_episode: int, states: Float, made: Float, columns: pa.Schema) -> pa.Table:
    """Returns rows of states (episodes, steps + 1, size) and what follows (episodes, steps, size).

    The latter is null in the last state of an episode.
    """
    episodes, steps, _ = made.shape
    step = np.tile(np.arange(steps + 1), episodes)
    padded = np.concatenate([made, np.zeros_like(made[:, :1])], axis=1)
    values = [
        np.repeat(np.arange(first_episode, first_episode + episodes), steps + 1),
        step,
        *states.reshape(len(step), states.shape[-1]).T,
        *(
            pa.array(column, mask=step == steps)
            for column in padded.reshape(len(step), padded.shape[-1]).T
        ),
    ]
    return pa.table(dict(zip(columns.names, values, strict=True)), schema=columns)


def flaw(steps: pa.Table, targets: pa.Table, episodes: range, episode_steps: int) -> str | None:
    """Returns a problem of the rows of whole episodes, to follow "holds"; None if they are valid.

    The episodes have the expected numbers; the rows have the columns of a `DatasetLayout`.
    """
    made = [name for name in steps.column_names if name.startswith("action") or name == "reward"]
    numbers = np.arange(episodes.start, episodes.stop)
    step_numbers = np.arange(episode_steps + 1)
    expected = (np.repeat(numbers, len(step_numbers)), np.tile(step_numbers, len(numbers)), numbers)
    columns = (steps["episode"], steps["step"], targets["episode"])
    if not all(map(np.array_equal, columns, expected)):
        return "other rows than those of whole episodes in their order"

    last = expected[1] == episode_steps
    if not all(np.array_equal(steps[name].is_null(), last) for name in made):
        return "a state without its action, or an action after the last state"

    for table in (steps.drop_columns(made), targets, steps.select(made).drop_null()):
        for name, column in zip(table.column_names, table.columns, strict=True):
            if column.null_count:
                return f"empty cells in the column {name}"
            if not np.isfinite(column.to_numpy()).all():
                return f"NaN or infinite values in the column {name}"

    return None
