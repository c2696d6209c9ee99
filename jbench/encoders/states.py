"""The scaled states of a dataset, split into training and held-out episodes.

Whole episodes are held out, so that no held-out state is adjacent to a training state. A dataset
that does not fit in memory is read in each epoch, file by file in random order.
"""

from collections.abc import Iterator
from functools import reduce
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from jbench.datasets import Dataset
from jbench.encoders.moments import Moments
from jbench.encoders.pairs import STATES, Shard
from jbench.encoders.scaling import Scaling
from jbench.errors import RequestError
from jbench.names import EPISODE_STEPS
from jbench.simulation import find_task

MEMORY = 1 << 30
"""Maximum number of bytes of states in memory; larger datasets are streamed."""

SAMPLE_EPISODES = 128
"""Maximum number of held-out episodes whose error is measured after each epoch."""

_TEST_SHARE = 0.2  # of the episodes (paper, section 5.2: 20% of the data)

Scale = Literal["dataset", "observation", "sd"]
"""Scale of the features: extremes over the dataset to [-1, 1], as observed, or unit variance."""

_Arrays = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
"""States, actions and rewards of some episodes."""


def split_episodes(episodes: int, seed: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the indices of the training episodes (80%) and of the held-out ones (20%)."""
    order = np.random.default_rng(np.random.SeedSequence(seed)).permutation(episodes)
    held_out = max(1, round(_TEST_SHARE * episodes))
    return np.sort(order[held_out:]), np.sort(order[:held_out])


class States:
    """A dataset as one task sees it, scaled, with episodes held out.

    Attributes:
        task: the states are observations of this task.
        seed: of the choice of held-out episodes.
        scale: of the features.
        size: number of features.
        action_size: number of actuators.
        device: of the states.
        scaling: of the observations; available after `read`, like the following ones.
        learned: moments of the scaled training states.
        held_out: moments of the scaled held-out states.
        sample: up to 128 held-out episodes.
    """

    scaling: Scaling
    learned: Moments
    held_out: Moments
    sample: Shard
    _whole: Shard

    def __init__(
        self,
        dataset: Dataset,
        task: str,
        seed: int,
        memory: int = MEMORY,
        scale: Scale = "dataset",
    ) -> None:
        """Prepares to read a dataset.

        Args:
            task: the states become observations of this task.
            seed: of the choice of held-out episodes.
            memory: maximum number of bytes of states in memory.

        Raises:
            RequestError: if the dataset has fewer than two episodes.
        """
        if dataset.episodes < 2:
            raise RequestError(
                f"The dataset {dataset.id} has one episode, and one is held out; type "
                "jbench collect with more --steps."
            )
        self.dataset, self.task, self.seed, self.scale = dataset, task, seed, scale
        found = find_task(task)
        self.size, self.action_size = found.observation_size, found.action_size
        self._actions = () if found.specs is None else (self.action_size,)
        learned, held_out = split_episodes(dataset.episodes, seed)
        # Training episodes first, then the held-out ones.
        self._order, self._first_held_out = np.concatenate([learned, held_out]), len(learned)
        self._memory = memory
        self.device = torch.device("cpu")
        self._read = False

    @property
    def in_memory(self) -> bool:
        """Whether all states fit in memory."""
        return self.dataset.episodes * STATES * self.size * 4 <= self._memory

    def read(self, device: torch.device) -> None:
        """Reads the dataset if necessary, and moves it to a device.

        Raises:
            WorkError: if the dataset is damaged or contains values that are not finite.
        """
        if not self._read:
            self._read_all()
            self._read = True
        if device != self.device:
            self.device = device
            self.sample = self.sample.to(device)
            if self.in_memory:
                self._whole = self._whole.to(device)

    def learn(self, random: torch.Generator | None = None) -> Iterator[Shard]:
        """Yields the training episodes.

        Args:
            random: shuffles the files of a dataset that does not fit in memory.
        """
        return self._episodes(slice(self._first_held_out), random)

    def test(self) -> Iterator[Shard]:
        """Yields the held-out episodes."""
        return self._episodes(slice(self._first_held_out, None))

    def all(self) -> Iterator[Shard]:
        """Yields all episodes."""
        return self._episodes(slice(None))

    def scaled(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns scaled observations (..., size)."""
        gain, offset = self.scaling.gain_and_offset()
        return observations * gain + offset

    def _read_all(self) -> None:
        """Reads extremes and moments of the dataset and, if they fit in memory, its states."""
        # Position of each episode in `_order`.
        order = np.argsort(self._order)
        first_held_out = self._first_held_out
        # All states, or only the sample, which is the beginning of the held-out episodes.
        first = 0 if self.in_memory else first_held_out
        last = len(order) if self.in_memory else min(len(order), first + SAMPLE_EPISODES)
        states = np.empty((last - first, STATES, self.size), np.float32)
        actions = np.empty((last - first, EPISODE_STEPS, *self._actions), np.float32)
        rewards = np.empty((last - first, EPISODE_STEPS), np.float32)
        moments = [Moments.none(self.size), Moments.none(self.size)]
        extremes: list[Scaling] = []
        for episodes, block in zip(self.dataset.parts, self.dataset.blocks(self.task), strict=True):
            block_order = order[episodes.start : episodes.stop]
            extremes.append(Scaling.of(block.observations))
            for i, mask in enumerate((block_order < first_held_out, block_order >= first_held_out)):
                moments[i] = moments[i].merged(Moments.of(block.observations[mask]))
            mask = (block_order >= first) & (block_order < last)
            states[block_order[mask] - first] = block.observations[mask]
            actions[block_order[mask] - first] = block.actions[mask]
            rewards[block_order[mask] - first] = block.rewards[mask]
        self.scaling = {
            "dataset": lambda: reduce(Scaling.merged, extremes),
            "observation": lambda: Scaling.none(self.size),
            "sd": lambda: Scaling.to_unit_variance(moments[0].merged(moments[1])),
        }[self.scale]()
        gain, offset = self.scaling.gain_and_offset()
        self.learned, self.held_out = (part.scaled(gain, offset) for part in moments)
        states *= gain
        states += offset
        self._whole = Shard(*map(torch.from_numpy, (states, actions, rewards)))
        at = first_held_out - first
        self.sample = Shard(*(part[at : at + SAMPLE_EPISODES] for part in self._whole))

    def _episodes(self, chosen: slice, random: torch.Generator | None = None) -> Iterator[Shard]:
        """Yields the chosen ones of the episodes in `_order`, in shards that fit in memory."""
        if self.in_memory:
            yield Shard(*(part[chosen] for part in self._whole))
            return
        parts = list(range(len(self.dataset.parts)))
        if random is not None:
            parts = torch.randperm(len(parts), generator=random).tolist()
        blocks = self.dataset.blocks(self.task, parts)
        # A third of the memory: a shard is joined while the previous one is still in use.
        max_episodes = max(1, self._memory // (3 * STATES * self.size * 4))
        gathered: list[_Arrays] = []
        held = 0
        for part, block in zip(parts, blocks, strict=True):
            mask = np.isin(self.dataset.parts[part], self._order[chosen])
            if held and held + mask.sum() > max_episodes:
                yield self._shard(gathered)
                gathered, held = [], 0
            scaled = self.scaled(block.observations[mask])
            gathered.append((scaled, block.actions[mask], block.rewards[mask]))
            held += int(mask.sum())
        if held:
            yield self._shard(gathered)

    def _shard(self, gathered: list[_Arrays]) -> Shard:
        parts = zip(*gathered, strict=True)
        return Shard(*(torch.from_numpy(np.concatenate(p)) for p in parts)).to(self.device)
