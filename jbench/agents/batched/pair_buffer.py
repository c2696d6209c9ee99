"""Replay buffers of several seeds whose episodes end at different control steps."""

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.replay import ReplayBuffer, Sampled, Sizes


class PairBuffer(ReplayBuffer):
    """Ring buffers in which a transition takes two rows, wherever its episode ends.

    Transition number t is in row 2 t, and the observation that follows it in row 2 t + 1, whose
    last column is 1 if nothing follows that: the number of a row does not depend on the lengths of
    the episodes, so all seeds and environments are at the same row. A million transitions with 16
    observed numbers take 144 MB in float32.
    """

    rows_per_transition = 2

    def __init__(
        self,
        sizes: Sizes,
        *,
        flush_every: int,
        episode_steps: int | None = None,
        ends_are_terminal: bool | None = None,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> None:
        """Allocates the buffers; see `ReplayBuffer`.

        Episodes have any length, and `end` says which ends are terminal.
        """
        super().__init__(
            sizes,
            flush_every=flush_every + 1,  # the current observation, too
            episode_steps=1,
            ends_are_terminal=True,
            dtype=dtype,
            device=device,
        )
        # On the CPU, where minibatches are sampled.
        shape = sizes.seeds, sizes.environments, self._capacity
        self._is_terminal = np.zeros(shape, bool)

    def add(
        self, actions: NDArray[np.floating], rewards: NDArray[np.floating], observations: Tensor
    ) -> None:
        """See `ReplayBuffer.add`; call `end` and `begin` after an episode's last step."""
        row = self._current_row
        row[..., self._size : -1].copy_(torch.from_numpy(actions))
        row[..., -1].copy_(torch.from_numpy(rewards))
        following = self._pending[:, :, self.row + 1 - self._flushed]
        following.zero_()
        following[..., : self._size].copy_(observations)
        self.row += 2
        self._current_row[..., : self._size].copy_(observations)

    def end(self, nothing_follows: NDArray[np.bool_]) -> None:
        """Notes after which transitions (seeds, environments) just added nothing follows."""
        self._pending[:, :, self.row - 1 - self._flushed, -1].copy_(
            torch.from_numpy(nothing_follows)
        )

    def flush(self) -> None:
        """Copies the rows added since the last call to the buffers."""
        count = self.row - self._flushed
        self._write(slice(None), self._flushed, self._pending[:, :, :count])
        self._pending[:, :, 0] = self._current_row
        self._flushed = self.row

    @property
    def oldest(self) -> int:
        """Number of the oldest row that has not expired."""
        return max(0, self.row - self._ring)

    def sample(self, generator: Generator, updates: int, batch: int, seed: int = 0) -> Sampled:
        """See `ReplayBuffer.sample`."""
        shape = updates, batch
        total = self._flushed // 2  # transitions of each environment at the last `flush`
        transitions = generator.integers(max(0, total - self._capacity), total, shape)
        places = transitions % self._capacity
        rows = 2 * places
        if self._environments == 1:
            return Sampled(rows, rows + 1, self._is_terminal[seed, 0, places])

        environments = generator.integers(self._environments, size=shape)
        rows = rows + environments * self._ring
        return Sampled(rows, rows + 1, self._is_terminal[seed, environments, places])

    def _write(self, seeds: slice, first: int, rows: Tensor) -> None:
        """Writes rows (seeds, environments, rows, width) from row number `first` on."""
        super()._write(seeds, first, rows)
        places = np.arange(first // 2, (first + rows.shape[2]) // 2) % self._capacity
        following = rows[:, :, 1::2, -1]
        self._is_terminal[seeds][:, :, places] = following.numpy() == 1

    def _clear_unused(self, rows: Tensor, has_action: Tensor) -> None:
        """Leaves rows as they are: `add` sets unused columns to 0."""

    def _span(self, transitions: int) -> int:
        """Returns the number of rows of this many consecutive transitions."""
        return self.rows_per_transition * transitions


def buffer_class(*, ends_early: bool) -> type[ReplayBuffer]:
    """Returns the class of the replay buffers of a task, whose episodes may end early or not."""
    return PairBuffer if ends_early else ReplayBuffer
