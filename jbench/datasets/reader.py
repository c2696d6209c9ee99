"""Reading a dataset with the observations and rewards of any task."""

import itertools
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.datasets import ending
from jbench.datasets.by_robot import find_layout, recorded_layout, recorded_robot
from jbench.datasets.failed import collecting_command, sentence_on_failed
from jbench.datasets.layout import Block, DatasetLayout
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


class Dataset:
    """A collected dataset of a robot: "jitterbug", or the task of another one.

    `parts` are the episodes of each file; `blocks(task, parts=[i])` reads part i. Those of a
    dataset without `has_one_length`, as some episodes ended early, are read by `ending_blocks`.
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
        counts = (entry.rows for entry in record.parts(self.layout.episodes))
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

        Raises a RequestError if there is no such task, or the dataset is of another robot, and a
        WorkError if a file is damaged or has invalid columns or values.
        """
        self._check_lengths()
        for part, *files in self._files(task, parts):
            yield self._block(task, part, *files)

    def ending_blocks(
        self, task: str, parts: Iterable[int] | None = None
    ) -> Iterator[ending.EndingBlock]:
        """Yields the dataset of a task whose episodes may end early, file by file; see `blocks`."""
        size = find_task(task).observation_size
        for part, *files in self._files(task, parts):
            yield ending.block(self._checked_rows(task, part, *files)[0], size)

    def _files(
        self, task: str, parts: Iterable[int] | None
    ) -> Iterator[tuple[range, FileEntry, FileEntry]]:
        """Yields the episodes of each part, and its files."""
        self.check_task(task)
        steps = self.record.parts(self.layout.steps)
        episodes = self.record.parts(self.layout.episodes)
        if len(steps) != len(episodes):
            raise WorkError(f"The manifest of the dataset {self.id} lacks files; collect it again.")

        for part in range(len(self.parts)) if parts is None else parts:
            yield self.parts[part], steps[part], episodes[part]

    def _check_lengths(self) -> None:
        """Raises a RequestError if episodes ended early, so that a block can't have them."""
        if not self.has_one_length:
            raise RequestError(
                f"Episodes of the dataset {self.id} ended early and have different lengths: read "
                "it by Dataset.ending_blocks."
            )

    def observations(self, task: str) -> NDArray[np.float32]:
        """Returns a task's observations (episodes, n, dim(O)) before each of n actions.

        Raises a RequestError if episodes have different lengths, and otherwise as `blocks`.
        """
        self.check_task(task)
        self._check_lengths()

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

    def _checked_rows(
        self, task: str, part: range, steps: FileEntry, episodes: FileEntry
    ) -> tuple[pa.Table, pa.Table]:
        """Returns the rows of a part's steps and episodes; a WorkError if they are not valid."""
        columns_of_steps, columns_of_episodes = self.layout.columns(task)
        rows = self.record.read_part(steps, columns_of_steps)
        of_episodes = self.record.read_part(episodes, columns_of_episodes)
        flaw = self.layout.flaw(rows, of_episodes, part, self.settings.episode_steps)
        if flaw is not None:
            raise WorkError(
                f"{steps.name} of the dataset {self.id} holds {flaw}; collect it again after "
                f"deleting {self.record.path}."
            )
        return rows, of_episodes

    def _block(self, task: str, part: range, steps: FileEntry, episodes: FileEntry) -> Block:
        """Returns the episodes of one file, with the observations of a task."""
        rows, of_episodes = self._checked_rows(task, part, steps, episodes)
        return self.layout.block(task, rows, of_episodes, self.settings.episode_steps)


def _small(task: Task) -> int:
    """Returns the control steps of a small dataset of a task: whole episodes."""
    length = task.episode_steps
    return math.ceil(100_000 / length) * length


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
    if files := changed[newest.id]:
        raise ChangedCodeError(
            f"{since_recorded(newest, files)}; run {collect}, or take it by --dataset {newest.id}.",
            files,
        )

    return newest
