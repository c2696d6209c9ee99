"""Replay buffers of several seeds, which store every observation once, and their minibatches."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor


class Batch:
    """Transitions (s, a, r, s') in reused buffers; a stack of seeds has a leading axis.

    Attributes:
        rows: (..., batch, dim(O) + dim(A) + 1) s, a and r, of which four attributes are views:
        state_actions: (..., batch, dim(O) + dim(A)) s and a, the input of a critic.
        observations: (..., batch, dim(O)) s.
        actions: (..., batch, dim(A)) a; overwritten by an update.
        rewards: (..., batch, 1) r.
        next_rows: s' and unused columns, with the following three views.
        next_state_actions, next_observations, next_actions: an update writes the actions.
        discounts: (..., batch, 1) gamma, or 0 where s' is terminal.
        noise: (..., batch, noise_per_transition) standard normal numbers.
        mean_weight: (..., batch, 1) 1 / batch, the gradient of a mean over the batch.
    """

    def __init__(
        self,
        rows: Tensor,
        next_rows: Tensor,
        discounts: Tensor,
        noise: Tensor,
        action_size: int = 1,
    ) -> None:
        size = rows.shape[-1] - action_size - 1
        self.rows = rows
        self.next_rows = next_rows
        self.discounts = discounts
        self.noise = noise
        self.state_actions = rows[..., :-1]
        self.rewards = rows[..., -1:]
        self.observations = rows[..., :size]
        self.actions = rows[..., size:-1]
        self.next_state_actions = next_rows[..., :-1]
        self.next_observations = next_rows[..., :size]
        self.next_actions = next_rows[..., size:-1]
        self.mean_weight = torch.full_like(discounts, 1 / rows.shape[-2])


@dataclass(frozen=True)
class Sizes:
    """Sizes of the replay buffers of several seeds; `environments` and `transitions` of each."""

    seeds: int
    environments: int
    transitions: int
    observation: int
    action: int


class Sampled(NamedTuple):
    """Sampled transitions of one seed; the arrays are (updates, batch).

    Attributes:
        rows: indices in the seed's buffer of the rows with s, a and r.
        next_rows: indices of the rows with s'.
        is_terminal: whether nothing follows a transition: its value is its reward alone.
    """

    rows: NDArray[np.int64]
    next_rows: NDArray[np.int64]
    is_terminal: NDArray[np.bool_]


class ReplayBuffer:
    """Ring buffers of the last transitions of each environment of each seed.

    An episode of n steps takes n + 1 rows: each observation with its action and reward, and the
    last observation with unused columns. Transition number t, counted from the start of
    training, is in row number t + t // n. A row is overwritten when all transitions that use it
    have expired. A million transitions with 16 observed numbers take 72 MB in float32.

    New rows are collected on the CPU until `flush` copies them to the buffers. `row` is the number
    of the row of the current observation, whose action is not yet known.
    """

    rows_per_transition = 1
    """Rows of the ring that a transition takes, but for one more row per episode."""

    def __init__(
        self,
        sizes: Sizes,
        *,
        flush_every: int,
        episode_steps: int,
        ends_are_terminal: bool = False,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> None:
        """Allocates the buffers; a CPU's memory fills with the transitions.

        Args:
            flush_every: most control steps of each environment between two calls of `flush`.
            episode_steps: control steps of every episode.
            ends_are_terminal: whether nothing follows the last transition of an episode.
        """
        self.has_terminals = ends_are_terminal
        """Whether there are terminal transitions."""

        self._episode_steps = episode_steps
        self._capacity = max(sizes.transitions // sizes.environments, 1)
        self._ring = self._span(self._capacity)
        self._environments = sizes.environments
        self._size = sizes.observation

        most_pending = self._span(flush_every)
        width = sizes.observation + sizes.action + 1
        shape = sizes.seeds, sizes.environments
        self._rows = torch.zeros(*shape, self._ring, width, dtype=dtype, device=device)
        self._pending = torch.zeros(*shape, most_pending, width, dtype=dtype)
        self.row = 0
        self._flushed = 0

    @property
    def environments(self) -> int:
        """Number of environments of each seed."""
        return self._environments

    def begin(self, observations: Tensor) -> None:
        """Starts episodes with observations (seeds, environments, size)."""
        self._current_row[..., : self._size].copy_(observations)

    def add(
        self, actions: NDArray[np.floating], rewards: NDArray[np.floating], observations: Tensor
    ) -> None:
        """Adds a transition (seeds, environments, any) of each environment.

        The observations are those after the actions; call `begin` after an episode's last step.
        """
        row = self._current_row
        row[..., self._size : -1].copy_(torch.from_numpy(actions))
        row[..., -1].copy_(torch.from_numpy(rewards))
        self.row += 1
        self._current_row[..., : self._size].copy_(observations)
        # The row of an episode's last observation has no transition of its own.
        if self.row % (self._episode_steps + 1) == self._episode_steps:
            self.row += 1

    def end(self, nothing_follows: NDArray[np.bool_]) -> None:
        """Notes after which transitions (seeds, environments) just added nothing follows.

        Episodes of one length need no note.
        """

    def flush(self) -> None:
        """Copies the rows added since the last call to the buffers."""
        count = self.row - self._flushed + 1
        self._write(slice(None), self._flushed, self._pending[:, :, :count])
        self._pending[:, :, 0] = self._current_row
        self._flushed = self.row

    @property
    def action_columns(self) -> slice:
        """The columns of rows that have the action."""
        return slice(self._size, -1)

    @property
    def oldest(self) -> int:
        """Number of the oldest row that has not expired."""
        return max(0, self.row - self._ring + 1)

    def sample(self, generator: Generator, updates: int, batch: int, seed: int = 0) -> Sampled:
        """Samples transitions of one seed uniformly."""
        shape = updates, batch
        # Transitions of each environment at the last `flush`.
        total = self._flushed - self._flushed // (self._episode_steps + 1)
        transitions = generator.integers(max(0, total - self._capacity), total, shape)
        episodes = transitions // self._episode_steps
        is_terminal = np.zeros(shape, bool)
        if self.has_terminals:
            is_terminal = transitions - episodes * self._episode_steps == self._episode_steps - 1

        rows = transitions + episodes
        next_rows = rows + 1
        if self._flushed >= self._ring:
            rows = rows % self._ring
            next_rows = next_rows % self._ring
        if self._environments > 1:
            offsets = generator.integers(self._environments, size=shape) * self._ring
            rows = rows + offsets
            next_rows = next_rows + offsets
        return Sampled(rows, next_rows, is_terminal)

    def seed_rows(self, seeds: range) -> Tensor:
        """Returns a view (rows, width) of the buffers of consecutive seeds; see `sample`."""
        return self._rows[seeds.start : seeds.stop].flatten(0, 2)

    def rows_since(self, seed: int, first: int = 0) -> Tensor:
        """Returns a copy of a seed's unexpired rows from number `first` on, but the current one.

        They are (environments, rows, width), with 0 in unused columns.
        """
        self.flush()
        numbers = torch.arange(max(first, self.oldest), self.row)
        indices = (numbers % self._ring).to(self._rows.device)
        rows = self._rows[seed].index_select(1, indices).cpu()
        self._clear_unused(rows, self.has_action(numbers))
        return rows

    def has_action(self, numbers: Tensor) -> Tensor:
        """Returns of which of these numbers of rows the row has an action and its reward."""
        return numbers % (self._episode_steps + 1) != self._episode_steps

    def row_number(self, transition: int) -> int:
        """Returns the number of the row of a transition, counted from the start of training."""
        return transition + transition // self._episode_steps

    def restore(self, seed: int, rows: Tensor, row: int) -> None:
        """Restores the rows (environments, rows, width) before number `row`; then call `begin`."""
        rows = rows[:, -self._ring :]
        self._write(slice(seed, seed + 1), row - rows.shape[1], rows[None])
        self.row = row
        self._flushed = row

    @property
    def _current_row(self) -> Tensor:
        """The rows (seeds, environments, width) of the current observations."""
        return self._pending[:, :, self.row - self._flushed]

    def _write(self, seeds: slice, first: int, rows: Tensor) -> None:
        """Writes rows (seeds, environments, rows, width) from row number `first` on."""
        done = 0
        count = rows.shape[2]
        while done < count:
            start = (first + done) % self._ring
            length = min(count - done, self._ring - start)
            self._rows[seeds, :, start : start + length] = rows[:, :, done : done + length]
            done += length

    def _clear_unused(self, rows: Tensor, has_action: Tensor) -> None:
        """Sets unused columns of rows (environments, rows, width), which are arbitrary, to 0."""
        rows[:, ~has_action, self._size :] = 0

    def _span(self, transitions: int) -> int:
        """Returns the maximum number of rows of this many consecutive transitions."""
        return transitions + -(-transitions // self._episode_steps) + 1
