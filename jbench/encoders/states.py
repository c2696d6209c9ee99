"""The scaled states of a dataset, of which encoders are trained on pairs.

Whole episodes are held out, so that no held-out state is adjacent to a training state. A dataset
that does not fit in memory is read in each epoch, file by file in random order.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from jbench.array_types import FloatArray
from jbench.datasets import Dataset
from jbench.datasets.block import Block
from jbench.encoders.pairs import Followed, Shard
from jbench.encoders.scaling import Moments, Scaling, physical_scaling
from jbench.errors import RequestError
from jbench.tasks.find import find_task

_SAMPLED = 128  # held-out episodes at most whose error is measured after each epoch
MAX_HORIZON = 1000
"""Control steps that an encoder may look ahead, less one; no more than an episode has."""

_TEST_SHARE = 0.2  # of the episodes (paper, section 5.2: 20% of the data)

Scale = Literal["dataset", "observation", "sd"]
"""Scale of the features: extremes over the dataset to [-1, 1], as observed, or unit variance."""


class Split(NamedTuple):
    """Numbers of the episodes of a dataset, each in one of two groups, in ascending order."""

    learned: NDArray[np.intp]  # 80%
    held_out: NDArray[np.intp]  # 20%


def check_episodes(dataset: Dataset) -> None:
    """Raises a RequestError if a dataset has a single episode, so that none can be held out."""
    if dataset.episodes > 1:
        return

    steps = 10 * dataset.settings.episode_steps
    raise RequestError(
        f"The dataset {dataset.id} has a single episode, and an encoder is trained on some and "
        f"tested on others; collect more: jbench collect{dataset.layout.option} --steps {steps}."
    )


def split_episodes(episodes: int, seed: int) -> Split:
    """Returns the random division of two episodes or more into training and held-out ones."""
    order = np.random.default_rng(np.random.SeedSequence(seed)).permutation(episodes)
    held_out = max(1, round(_TEST_SHARE * episodes))
    return Split(learned=np.sort(order[held_out:]), held_out=np.sort(order[:held_out]))


class States:
    """A dataset as one task sees it, scaled, with episodes held out.

    Attributes:
        columns: which features of the observation the states have, in order: all, or those that
            `only` has chosen.
        scaling: of the features; available after `read`, like the following ones.
        learned, held_out: moments of the scaled training states and of the held-out ones.
        sample: up to 128 held-out episodes.
        in_memory: whether all states fit in memory.
    """

    scaling: Scaling
    learned: Moments
    held_out: Moments
    sample: Shard

    def __init__(
        self, dataset: Dataset, task: str, seed: int, memory: int = 2**30, scale: Scale = "dataset"
    ) -> None:
        """Prepares to read a dataset, of which at most `memory` bytes of states are kept."""
        self.dataset = dataset
        self.task = task
        self.seed = seed
        self.scale = scale
        self.size = find_task(task).observation_size
        self.columns = list(range(self.size))
        self.action_size = find_task(task).action_size
        check_episodes(dataset)
        self._numbers = split_episodes(dataset.episodes, seed)._asdict()  # of episodes, by side
        self._memory = memory
        # None for all features, since a reference to itself would be a cycle.
        self._chosen_from: States | None = None
        steps = dataset.control_steps / dataset.episodes  # of an episode, on average
        self._episode_bytes = round((steps + 1) * self.size * 4)
        self.in_memory = dataset.episodes * self._episode_bytes <= memory
        self.device = torch.device("cpu")
        self._kept: dict[str, Shard] = {}  # empty before `read`, and if they do not fit in memory

    def read(self, device: torch.device) -> None:
        """Reads the dataset if necessary, and moves it to a device; WorkError if it is damaged."""
        if not hasattr(self, "scaling"):
            self._read_all()
        if device != self.device:
            self.device = device
            self.sample = self.sample.to(device)
            self._kept = {name: shard.to(device) for name, shard in self._kept.items()}

    def only(self, columns: Sequence[int]) -> "States":
        """Returns these states, which have been read, with some of the observation's features."""
        chosen = copy.copy(self)
        chosen._chosen_from = self.whole
        chosen.columns = list(columns)
        chosen.size = len(chosen.columns)
        chosen.scaling = self.scaling.only(columns)
        chosen.learned = self.learned.only(columns)
        chosen.held_out = self.held_out.only(columns)
        chosen.sample = self.sample.only(columns)
        chosen._kept = {name: shard.only(columns) for name, shard in self._kept.items()}
        return chosen

    @property
    def whole(self) -> "States":
        """The same states with all features."""
        return self if self._chosen_from is None else self._chosen_from

    @property
    def is_observed(self) -> list[bool]:
        """Whether each value of an observation is one of the features."""
        return [column in self.columns for column in range(self.whole.size)]

    @property
    def labels(self) -> list[str]:
        """The names of the features."""
        names = find_task(self.task).labels
        return [names[column] for column in self.columns]

    def physical_scaling(self) -> tuple[FloatArray, FloatArray]:
        """Returns (size,) gain and offset: features in SI units = gain * scaled + offset."""
        gain, offset = physical_scaling(self.task, self.whole.scaling)
        return gain[self.columns], offset[self.columns]

    def learn(self, random: torch.Generator | None = None) -> Iterator[Shard]:
        """Yields the training episodes; `random` shuffles files that do not fit in memory."""
        return self._shards("learned", random)

    def test(self) -> Iterator[Shard]:
        """Yields the held-out episodes."""
        return self._shards("held_out")

    def scaled(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the scaled features (..., size) of observations (..., dim(O))."""
        gain, offset = self.scaling.gain_and_offset()
        return observations[..., self.columns] * gain + offset

    def _read_all(self) -> None:
        """Reads all files once: the extremes for the scaling, and the episodes that are kept."""
        kept: dict[str, list[Block]] = {name: [] for name in self._numbers}
        moments = dict.fromkeys(self._numbers, Moments.of(np.empty((0, self.size))))
        extremes: list[Scaling] = []
        for part, block in zip(self.dataset.parts, self.dataset.blocks(self.task), strict=True):
            extremes.append(Scaling.of(block.states))
            for name, numbers in self._numbers.items():
                chosen = block.only(np.isin(part, numbers))
                moments[name] = moments[name].merged(Moments.of(chosen.states))
                is_sampled = name == "held_out" and _count(kept[name]) < _SAMPLED
                if self.in_memory or is_sampled:
                    kept[name].append(chosen)

        if self.scale == "dataset":
            self.scaling = reduce(Scaling.merged, extremes)
        elif self.scale == "observation":
            ones = np.ones(self.size, np.float32)
            self.scaling = Scaling(-ones, ones)
        else:
            observed = moments["learned"].merged(moments["held_out"])
            ends = np.outer([-1, 1], np.sqrt(np.diag(observed.covariance))) + observed.mean
            self.scaling = Scaling.of(ends.astype(np.float32))

        gain, offset = self.scaling.gain_and_offset()
        self.learned, self.held_out = (part.scaled(gain, offset) for part in moments.values())
        held_out = self._shard(kept.pop("held_out"))
        if self.in_memory:
            self._kept = {"learned": self._shard(kept.pop("learned")), "held_out": held_out}

        self.sample = held_out.first(_SAMPLED)

    def _shards(self, name: str, random: torch.Generator | None = None) -> Iterator[Shard]:
        """Yields the training or the held-out episodes, in shards that fit in memory."""
        if self.in_memory:
            yield self._kept[name]
            return
        if self.whole is not self:
            for shard in self.whole._shards(name, random):
                yield shard.only(self.columns)
            return

        parts = list(range(len(self.dataset.parts)))
        if random is not None:
            parts = torch.randperm(len(parts), generator=random).tolist()

        # A third of the memory: a shard is joined while the previous one is still in use.
        max_episodes = max(1, self._memory // (3 * self._episode_bytes))
        gathered: list[Block] = []
        for part, block in zip(parts, self.dataset.blocks(self.task, parts), strict=True):
            is_chosen = np.isin(self.dataset.parts[part], self._numbers[name])
            chosen = block.only(is_chosen)
            if gathered and _count([*gathered, chosen]) > max_episodes:
                yield self._shard(gathered)
                gathered = []
            if len(chosen.rewards):
                gathered.append(chosen)

        if gathered:
            yield self._shard(gathered)

    def _shard(self, gathered: list[Block]) -> Shard:
        """Returns episodes as tensors on the device, their states scaled."""
        has_one_length = self.dataset.has_one_length
        parts: list[tuple[NDArray[Any], ...]]
        if has_one_length:
            parts = [
                (block.observations, block.action_vectors, block.rewards) for block in gathered
            ]
        else:
            parts = [block.in_a_row() for block in gathered]

        scaled, *others = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        gain, offset = self.scaling.gain_and_offset()
        scaled *= gain
        scaled += offset
        states = torch.from_numpy(scaled)
        actions, rewards, *followed = map(torch.from_numpy, others)
        if has_one_length:
            return Shard(states, actions, rewards).to(self.device)

        in_a_row = Shard(states[None], actions[None], rewards[None], Followed(followed[0]))
        return in_a_row.to(self.device)


def _count(blocks: Iterable[Block]) -> int:
    """Returns how many episodes blocks have."""
    return sum(len(block.rewards) for block in blocks)
