"""The replay buffers of several seeds: whole episodes, every observation kept once."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.names import EPISODE_STEPS


class Draws(NamedTuple):
    """Transitions that one seed's updates learn from, (updates, batch) of them.

    Attributes:
        rows: the row of each in its seed's buffer.
        next_rows: the row of the observation that followed.
        last: whether it was the last one of its episode.
    """

    rows: NDArray[np.int64]
    next_rows: NDArray[np.int64]
    last: NDArray[np.bool_]


class ReplayBuffer:
    """The last transitions of each environment of each seed.

    An episode of n steps is n + 1 rows: each observation with the action and the reward that
    followed, and the last observation with two numbers that mean nothing. Transition t, counted
    from the first one ever, is in row t + t // n, counted from the first one ever; a row is
    overwritten once all transitions that it is needed for are too old to count. So a million
    transitions of 16 numbers are 72 MB in float32.

    New rows wait on the CPU for `flush`, so that updates may go on in another thread meanwhile.

    Attributes:
        row: number of the row of the observation now, whose action is not yet known.
    """

    def __init__(
        self,
        seeds: int,
        environments: int,
        capacity: int,
        observation_size: int,
        *,
        flush_every: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
        episode_steps: int = EPISODE_STEPS,
    ) -> None:
        """Asks the system for memory, which on a CPU is taken as the buffers fill.

        Args:
            seeds: how many.
            environments: of each seed.
            capacity: transitions of each seed, over all its environments.
            observation_size: numbers in an observation.
            flush_every: steps after which `flush` is called at the latest.
            dtype: of what is kept.
            device: where it is kept.
            episode_steps: transitions in an episode.
        """
        self._episode_steps = episode_steps
        self._capacity = max(capacity // environments, 1)
        self._ring, waiting = self._span(self._capacity), self._span(flush_every)
        self._environments, width = environments, observation_size + 2
        self._rows = torch.zeros(
            (seeds, environments, self._ring, width), dtype=dtype, device=device
        )
        self._new = torch.zeros((seeds, environments, waiting, width), dtype=dtype)
        self.row = self._flushed = 0

    def begin(self, observations: Tensor) -> None:
        """Begins episodes with observations (seeds, environments, size)."""
        self._now[..., :-2].copy_(observations)

    def add(
        self, actions: NDArray[np.floating], rewards: NDArray[np.floating], observations: Tensor
    ) -> None:
        """Adds a transition of each environment; after an episode's last one, `begin` the next.

        Args:
            actions: (seeds, environments) since the last observations.
            rewards: (seeds, environments).
            observations: (seeds, environments, size) that they led to.
        """
        now = self._now
        now[..., -2].copy_(torch.from_numpy(actions))
        now[..., -1].copy_(torch.from_numpy(rewards))
        self.row += 1
        self._now[..., :-2].copy_(observations)
        if self.row % (self._episode_steps + 1) == self._episode_steps:
            self.row += 1

    def flush(self) -> None:
        """Makes what was added since the last time a part of the buffer."""
        count = self.row - self._flushed + 1
        self._write(slice(None), self._flushed, self._new[:, :, :count])
        self._new[:, :, 0] = self._now
        self._flushed = self.row

    @property
    def oldest(self) -> int:
        """Number of the oldest row that counts, or will be the oldest to count once it is full."""
        return max(0, self.row - self._ring + 1)

    def transitions(self) -> int:
        """Returns how many each environment has had by the last `flush`."""
        return self._flushed - self._flushed // (self._episode_steps + 1)

    def draw(self, generator: Generator, updates: int, batch: int) -> Draws:
        """Draws transitions of one seed, each as likely as any other."""
        total, shape = self.transitions(), (updates, batch)
        drawn = generator.integers(max(0, total - self._capacity), total, shape)
        episodes = drawn // self._episode_steps
        last = drawn - episodes * self._episode_steps == self._episode_steps - 1
        places = drawn + episodes
        next_places = places + 1
        if self._flushed >= self._ring:
            places, next_places = places % self._ring, next_places % self._ring
        if self._environments > 1:
            before = generator.integers(self._environments, size=shape) * self._ring
            places, next_places = places + before, next_places + before
        return Draws(places, next_places, last)

    def rows_of(self, seeds: range) -> Tensor:
        """Returns a view of the rows of seeds that follow each other, equally many of each.

        Of one seed, these are the rows that `Draws` mean.
        """
        return self._rows[seeds.start : seeds.stop].flatten(0, 2)

    def rows_since(self, seed: int, first: int) -> Tensor:
        """Returns a copy of a seed's rows from number `first` on, (environments, rows, size + 2).

        What was too old to count is left out, and so is the row of the observation now. Nothing
        else may be under way.
        """
        self.flush()
        first = max(first, self.oldest)
        places = torch.arange(first, self.row, device=self._rows.device) % self._ring
        return self._rows[seed].index_select(1, places).cpu()

    def restore(self, seed: int, rows: Tensor, row: int) -> None:
        """Puts back the rows before number `row`, as many as count; then, `begin`.

        Args:
            seed: whose they are.
            rows: (environments, rows, size + 2), the last of them number `row` - 1.
            row: that of the observation now, the same for all seeds.
        """
        rows = rows[:, -self._ring :]
        self._write(slice(seed, seed + 1), row - rows.shape[1], rows[None])
        self.row = self._flushed = row

    @property
    def _now(self) -> Tensor:
        """The row of the observation now, (seeds, environments, size + 2)."""
        return self._new[:, :, self.row - self._flushed]

    def _write(self, seeds: slice, first: int, rows: Tensor) -> None:
        """Writes rows (seeds, environments, rows, size + 2) of numbers from `first` on."""
        done, count = 0, rows.shape[2]
        while done < count:
            place = (first + done) % self._ring
            fitting = min(count - done, self._ring - place)
            self._rows[seeds, :, place : place + fitting] = rows[:, :, done : done + fitting]
            done += fitting

    def _span(self, transitions: int) -> int:
        """Returns how many rows that many consecutive transitions need at most."""
        return transitions + -(-transitions // self._episode_steps) + 1
