"""Reading a dataset: any task's observations and rewards, out of the one simulation."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.datasets import layout
from jbench.errors import RequestError, WorkError
from jbench.names import EPISODE_STEPS
from jbench.store import Record, Results
from jbench.tasks import features


class Block(NamedTuple):
    """Some episodes of a dataset, as one task sees them.

    Attributes:
        observations: (episodes, 1001, dim(O)) float32, the last after the last action.
        actions: (episodes, 1000) float32.
        rewards: (episodes, 1000) float32, each read at the end of its control step.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]


class Dataset:
    """A collected dataset."""

    def __init__(self, record: Record) -> None:
        """Opens the dataset of a record."""
        self.record = record
        self.id = record.id
        self.episodes = record.rows("dataset_episodes")

    def blocks(self, task: str) -> Iterator[Block]:
        """Gives the dataset file by file, each checked against the manifest, as a task sees it.

        Args:
            task: one of `jbench.names.TASKS`.

        Raises:
            WorkError: if a file is damaged; it names the file.
        """
        files = self.record.parts("steps"), self.record.parts("dataset_episodes")
        if len(files[0]) != len(files[1]):
            raise WorkError(f"The manifest of the dataset {self.id} lacks files; collect it anew.")
        for steps, episodes in zip(*files, strict=True):
            rows = self.record.read_part(steps, layout.STEPS)
            state = layout.state_of(rows, EPISODE_STEPS)
            drawn = layout.target_of(task, self.record.read_part(episodes, layout.EPISODES))
            target = features.Target(
                np.broadcast_to(drawn.position, (*state.position.shape[:-1], 3)),
                np.broadcast_to(drawn.yaw, state.position.shape[:-1]),
            )
            actions = rows["action"].to_numpy().reshape(-1, EPISODE_STEPS + 1)
            yield Block(
                features.observation(task, state, target),
                actions[:, :-1],
                features.reward(task, state, target)[:, 1:],
            )

    def observations(self, task: str) -> NDArray[np.float32]:
        """Returns (episodes, 1000, dim(O)): what a task's agent saw before each action.

        Raises:
            WorkError: if a file is damaged, or holds a number that is not finite.
        """
        size = features.TASK_SPECS[task].observation_size
        observations = np.empty((self.episodes, EPISODE_STEPS, size), np.float32)
        first = 0
        for block in self.blocks(task):
            last = first + len(block.observations)
            observations[first:last] = block.observations[:, :-1]
            first = last
        if not np.isfinite(observations).all():
            raise WorkError(f"The dataset {self.id} holds NaN or infinite values; collect it anew.")
        return observations


def find_dataset(results: Results, id: str | None = None) -> Dataset:
    """Returns a dataset by its id, or the newest finished one.

    Raises:
        RequestError: if there is none, or it is not finished; it says how to collect one.
    """
    if id is not None:
        record = results.find("dataset", id)
        if record is None:
            known = [record.id for record in results.scan("dataset")[0]]
            raise RequestError(
                f"No dataset {id} in {results.path}; "
                + (f"there are {', '.join(known)}." if known else "run jbench collect first.")
            )
        if record.status != "finished":
            raise RequestError(
                f"The dataset {id} is unfinished; type the jbench collect command that began it "
                "again and it continues."
            )
        return Dataset(record)
    records, problems = results.scan("dataset")
    finished = [record for record in records if record.status == "finished"]
    if not finished:
        reason = f" ({problems[0]})" if problems else ""
        raise RequestError(
            f"No finished dataset in {results.path}{reason}; run jbench collect first "
            "(--steps 100000 makes a small one)."
        )
    return Dataset(max(finished, key=lambda record: record.manifest.updated))
