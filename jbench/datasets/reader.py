"""Reading a dataset with the observations and rewards of any task."""

import itertools
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jbench.datasets.block import Block
from jbench.datasets.by_robot import find_layout, recorded_layout, recorded_robot
from jbench.datasets.failed import collecting_command, sentence_on_failed
from jbench.datasets.layout import DatasetLayout
from jbench.datasets.rows import flaw
from jbench.errors import RequestError, WorkError
from jbench.names import TASKS
from jbench.settings.base import validated
from jbench.settings.records import DatasetSettings
from jbench.store import Record, Results
from jbench.store.code import ChangedCodeError, changed_files, since_recorded
from jbench.store.manifest import FileEntry
from jbench.store.shipped import results_to_read
from jbench.tasks.find import check_specs, find_task
from jbench.tasks.task import Task

_SMALL = 100_000
"""Control steps of a small dataset, or a few more."""


class Dataset:
    """A collected dataset of a robot: "jitterbug", or the task of another one.

    Attributes:
        episodes: how many it has.
        control_steps: of all episodes together.
        parts: the numbers of the episodes of each file; `blocks(task, parts=[i])` reads part i.
    """

    def __init__(self, record: Record) -> None:
        """Reads the settings of a dataset and counts its episodes; rows are read later."""
        self.record = record
        self.id = record.id
        self.settings = validated(
            DatasetSettings, f"the dataset {record.id} in {record.path}", **record.settings
        )
        self.robot = self.settings.robot
        self.layout = find_layout(self.robot)
        counts = (entry.rows for entry in record.parts(self.layout.episode_table))
        bounds = [*itertools.accumulate(counts, initial=0)]
        self.episodes = bounds[-1]
        self.parts = tuple(range(*pair) for pair in itertools.pairwise(bounds))
        self.control_steps = self.layout.control_steps(record)

    @property
    def has_one_length(self) -> bool:
        """Whether no episode ended before the time limit of its task."""
        if not self.layout.ends_early:
            return True
        return self.control_steps == self.episodes * self.settings.episode_steps

    def blocks(self, task: str, parts: Iterable[int] | None = None) -> Iterator[Block]:
        """Yields the dataset for a task, file by file (`parts`), with one file in memory at a time.

        An episode that ended early is followed by zeros, see `Block`.

        Raises a RequestError if there is no such task, or the dataset is of another robot, and a
        WorkError if a file is damaged or has invalid columns or values.
        """
        self.check_task(task)
        step_files = self.record.parts(self.layout.step_table)
        episode_files = self.record.parts(self.layout.episode_table)
        if len(step_files) != len(episode_files):
            raise WorkError(f"The manifest of the dataset {self.id} lacks files; collect it again.")

        for part in range(len(self.parts)) if parts is None else parts:
            yield self._block(task, self.parts[part], step_files[part], episode_files[part])

    def observations(self, task: str) -> NDArray[np.float32]:
        """Returns a task's observations (episodes, n, dim(O)) before each of n actions.

        Raises a RequestError if episodes have different lengths, and otherwise as `blocks`.
        """
        self.check_task(task)
        if not self.has_one_length:
            raise RequestError(
                f"Episodes of the dataset {self.id} ended early and have different lengths: read "
                "it by Dataset.blocks."
            )

        size = find_task(task).observation_size
        observations = np.empty((self.episodes, self.settings.episode_steps, size), np.float32)
        for episodes, block in zip(self.parts, self.blocks(task), strict=True):
            observations[episodes.start : episodes.stop] = block.observations[:, :-1]

        return observations

    def check_task(self, task: str) -> None:
        """Raises a RequestError if it has no observations of a task."""
        if find_task(task).robot != self.robot:
            raise RequestError(
                f"The dataset {self.id} is of {self.robot}, not of {task}; name another with "
                f"--dataset, or type jbench collect --task {task}."
            )
        check_specs(task, self.settings.specs)

    def _block(
        self, task: str, episodes: range, step_file: FileEntry, episode_file: FileEntry
    ) -> Block:
        """Returns the episodes of one file; a WorkError if its rows are not valid."""
        step_columns, episode_columns = self.layout.columns(task)
        step_rows = self.record.read_part(step_file, step_columns)
        episode_rows = self.record.read_part(episode_file, episode_columns)
        episode_steps = self.settings.episode_steps
        problem = flaw(step_rows, episode_rows, episodes, episode_steps)
        if problem is not None:
            raise WorkError(
                f"{step_file.name} of the dataset {self.id} holds {problem}; collect it again "
                f"after deleting {self.record.path}."
            )
        return self.layout.block(task, step_rows, episode_rows, episode_steps)


def _small(task: Task) -> int:
    """Returns the control steps of a small dataset of a task, which `collect` takes."""
    if task.ends_early:
        return _SMALL
    return math.ceil(_SMALL / task.episode_steps) * task.episode_steps


def find_dataset(
    results: Results | Path | str, id: str | None = None, task: str = TASKS[0]
) -> Dataset:
    """Returns a dataset by its id, or the newest finished one of a robot that is not augmented.

    Raises a RequestError if there is none, it is not finished, or, without an id, the code of its
    task has changed.
    """
    results = results_to_read(results)
    about = find_task(task)
    if id is not None:
        layout = find_layout(about.robot)
        return Dataset(_named(results, results.complete_id("dataset", id), layout))

    return Dataset(_newest(results, about))


def _named(results: Results, id: str, layout: DatasetLayout) -> Record:
    """Returns a finished dataset by its id; a RequestError otherwise, which says what to type.

    If there is none, that is the command for a dataset of the robot of `layout`.
    """
    record = results.find("dataset", id)
    if record is None:
        ids = ", ".join(record.id for record in results.scan("dataset")[0])
        more = f"there are {ids}." if ids else f"run {collecting_command(results, layout)} first."
        raise RequestError(f"No dataset {id} in {results.name}; {more}")

    if record.status == "failed":
        raise RequestError(sentence_on_failed(record, results, recorded_layout(record)))

    if not record.is_finished:
        raise RequestError(
            f"The dataset {id} is unfinished; type the jbench collect command that started it "
            "to resume it."
        )

    return record


def _newest(results: Results, task: Task) -> Record:
    """Returns the newest finished dataset of a task's robot that is not augmented.

    Raises a RequestError if there is none, or its code has changed.
    """
    layout = find_layout(task.robot)
    collect = collecting_command(results, layout)
    records, problems = results.scan("dataset")
    suitable = [record for record in records if recorded_robot(record) == task.robot]
    finished = [record for record in suitable if record.is_finished]
    failed = [record for record in suitable if record.status == "failed"]
    if failed and not finished:
        raise RequestError(sentence_on_failed(failed[0], results, layout))

    if not finished:
        reason = f" ({problems[0]})" if problems else ""
        raise RequestError(
            f"No finished dataset{layout.of_robot} in {results.name}{reason}; run "
            f"{collect} first (--steps {_small(task)} makes a small one)."
        )

    plain = [record for record in finished if record.settings.get("augment") is None]
    if not plain:
        raise RequestError(
            f"Every finished dataset in {results.name} is of an augmented robot; name one with "
            f"--dataset: {', '.join(record.id for record in finished)}."
        )

    now = layout.code()
    changed = {record.id: changed_files(record.manifest.provenance, now) for record in plain}
    newest = max(plain, key=lambda record: (not changed[record.id], record.manifest.updated))
    files = changed[newest.id]
    if files:
        raise ChangedCodeError(
            f"{since_recorded(newest, files)}; run {collect}, or take it by --dataset {newest.id}.",
            files,
        )

    return newest
