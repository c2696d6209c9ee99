"""Replay buffers of several seeds, which store every observation once."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.names import EPISODE_STEPS


class SampledIndices(NamedTuple):
    """Sampled transitions of one seed, each (updates, batch).

    Attributes:
        rows: index of the transition's row in the seed's buffer.
        next_rows: index of the row of the next observation.
        last: whether it is the last transition of its episode.
    """

    rows: NDArray[np.int64]
    next_rows: NDArray[np.int64]
    last: NDArray[np.bool_]


class ReplayBuffer:
    """Ring buffers of the last transitions of each environment of each seed.

    An episode of n steps takes n + 1 rows: each observation with its action and reward, and the
    last observation with unused columns. Transition number t, counted from the start of
    training, is in row number t + t // n. A row is overwritten when all transitions that use it
    have expired. A million transitions with 16 observed numbers take 72 MB in float32.

    New rows are collected on the CPU until `flush` copies them to the buffers.

    Attributes:
        row: number of the row of the current observation, whose action is not yet known.
    """

    def __init__(
        self,
        seeds: int,
        environments: int,
        capacity: int,
        observation_size: int,
        action_size: int,
        *,
        flush_every: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Allocates the buffers; on a CPU the system provides memory as they fill.

        Args:
            environments: per seed.
            capacity: transitions per seed, over all its environments.
            flush_every: maximum number of steps between calls of `flush`.
            episode_steps: transitions in an episode.
        """
        self._episode_steps = episode_steps
        self._capacity = max(capacity // environments, 1)
        self._ring, pending = self._span(self._capacity), self._span(flush_every)
        self._environments, self._size = environments, observation_size
        width = observation_size + action_size + 1
        self._rows = torch.zeros(
            (seeds, environments, self._ring, width), dtype=dtype, device=device
        )
        self._new = torch.zeros((seeds, environments, pending, width), dtype=dtype)
        self.row = self._flushed = 0

    def begin(self, observations: Tensor) -> None:
        """Starts episodes with observations (seeds, environments, size)."""
        self._current_row[..., : self._size].copy_(observations)

    def add(
        self, actions: NDArray[np.floating], rewards: NDArray[np.floating], observations: Tensor
    ) -> None:
        """Adds a transition of each environment; call `begin` after the last one of an episode.

        Args:
            actions: (seeds, environments, action_size).
            rewards: (seeds, environments).
            observations: (seeds, environments, size) after the actions.
        """
        row = self._current_row
        row[..., self._size : -1].copy_(torch.from_numpy(actions))
        row[..., -1].copy_(torch.from_numpy(rewards))
        self.row += 1
        self._current_row[..., : self._size].copy_(observations)
        if self.row % (self._episode_steps + 1) == self._episode_steps:
            self.row += 1

    def flush(self) -> None:
        """Copies the rows added since the last call to the buffers."""
        count = self.row - self._flushed + 1
        self._write(slice(None), self._flushed, self._new[:, :, :count])
        self._new[:, :, 0] = self._current_row
        self._flushed = self.row

    @property
    def oldest(self) -> int:
        """Number of the oldest row that has not expired."""
        return max(0, self.row - self._ring + 1)

    def transitions(self) -> int:
        """Returns the number of transitions of each environment at the last `flush`."""
        return self._flushed - self._flushed // (self._episode_steps + 1)

    def sample(self, generator: Generator, updates: int, batch: int) -> SampledIndices:
        """Samples transitions of one seed uniformly."""
        total, shape = self.transitions(), (updates, batch)
        transitions = generator.integers(max(0, total - self._capacity), total, shape)
        episodes = transitions // self._episode_steps
        last = transitions - episodes * self._episode_steps == self._episode_steps - 1
        rows = transitions + episodes
        next_rows = rows + 1
        if self._flushed >= self._ring:
            rows, next_rows = rows % self._ring, next_rows % self._ring
        if self._environments > 1:
            offsets = generator.integers(self._environments, size=shape) * self._ring
            rows, next_rows = rows + offsets, next_rows + offsets
        return SampledIndices(rows, next_rows, last)

    def seed_rows(self, seeds: range) -> Tensor:
        """Returns a view (rows, width) of the buffers of consecutive seeds.

        `SampledIndices` are indices into the rows of a single seed.
        """
        return self._rows[seeds.start : seeds.stop].flatten(0, 2)

    def rows_since(self, seed: int, first: int = 0) -> Tensor:
        """Returns a copy of a seed's rows from number `first` on, (environments, rows, width).

        Expired rows and the row of the current observation are left out.
        """
        self.flush()
        first = max(first, self.oldest)
        indices = torch.arange(first, self.row, device=self._rows.device) % self._ring
        return self._rows[seed].index_select(1, indices).cpu()

    def restore(self, seed: int, rows: Tensor, row: int) -> None:
        """Restores the rows before number `row`; call `begin` afterwards.

        Args:
            rows: (environments, rows, width) up to row number `row` - 1.
            row: number of the row of the current observation, the same for all seeds.
        """
        rows = rows[:, -self._ring :]
        self._write(slice(seed, seed + 1), row - rows.shape[1], rows[None])
        self.row = self._flushed = row

    @property
    def _current_row(self) -> Tensor:
        """The row of the current observation, (seeds, environments, width)."""
        return self._new[:, :, self.row - self._flushed]

    def _write(self, seeds: slice, first: int, rows: Tensor) -> None:
        """Writes rows (seeds, environments, rows, width) from row number `first` on."""
        done, count = 0, rows.shape[2]
        while done < count:
            start = (first + done) % self._ring
            length = min(count - done, self._ring - start)
            self._rows[seeds, :, start : start + length] = rows[:, :, done : done + length]
            done += length

    def _span(self, transitions: int) -> int:
        """Returns the maximum number of rows of this many consecutive transitions."""
        return transitions + -(-transitions // self._episode_steps) + 1
