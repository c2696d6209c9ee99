"""What the datasets of a robot are like: their tables, how they are collected and read.

Steps are rows of whole episodes, each a state and the action that follows it; the last state of an
episode has no action. Another table has a row for each episode.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import pyarrow as pa

from jbench.datasets.block import Block
from jbench.errors import RequestError
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.store.planned import Planned


class DatasetLayout(ABC):
    """The datasets of a robot; `by_robot.find_layout` has that of a name.

    Attributes:
        step_table: name of the table of states and actions.
        episode_table: name of the table with a row for each episode.
        task: the one whose observations are read if no other is named.
        option: what names the robot in a command line, with a space before it.
        of_robot: the same in a sentence.
    """

    step_table: ClassVar[str]
    episode_table: ClassVar[str]
    task: str
    option: str = ""
    of_robot: str = ""

    def control_steps(self, record: Record) -> int:
        """Returns the control steps of the committed episodes of a dataset."""
        # An episode has one row more than control steps.
        return record.rows(self.step_table) - record.rows(self.episode_table)

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

    def check_steps(self, settings: DatasetSettings) -> None:
        """Raises a RequestError if the last episode would be cut, unless any may end early."""
        length = settings.episode_steps
        if not settings.steps % length or self.ends_early:
            return

        up = (settings.steps // length + 1) * length
        raise RequestError(
            f"steps can't be {settings.steps}: an episode{self.of_robot} has {length} control "
            f"steps; steps must be a multiple, such as {up}."
        )

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
    def block(
        self, task: str, step_rows: pa.Table, episode_rows: pa.Table, episode_steps: int
    ) -> Block:
        """Returns observations and rewards of a task from rows without a flaw, see `rows.flaw`."""

    @abstractmethod
    def minari_id(self, dataset: str, task: str) -> str:
        """Returns Minari's id of the dataset with an id, with the observations of a task."""
