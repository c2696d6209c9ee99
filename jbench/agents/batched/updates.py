"""Off-policy updates: sampling minibatches per seed and updating each group of seeds."""

from collections.abc import Hashable, Sequence

import numpy as np
import torch
from torch import Tensor

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.team import Group
from jbench.names import TimeLimit
from jbench.settings.algorithms import OffPolicySettings

_MAX_SAMPLED = 1000  # minibatches of pretraining that are sampled at once
_RECORDED = 10  # updates of a stack in one CUDA graph: fewer copies and launches


class Updates:
    """The updates of one group of seeds.

    Random numbers for all updates of a learning phase are drawn on the CPU at once. The updates
    then read theirs from the same buffers, so that a GPU can replay them as a CUDA graph: several
    updates of a stack, or one update of a single seed.
    """

    def __init__(
        self,
        settings: OffPolicySettings,
        group: Group[OffPolicyLearner],
        replay: ReplayBuffer,
        time_limit: TimeLimit,
        updates: int = _RECORDED,
        *,
        mirror: Tensor | None = None,
    ) -> None:
        """Makes the buffers.

        Args:
            replay: buffers of all seeds.
            time_limit: "bootstrap" from an episode's last state, or treat it as "terminal".
            updates: in a learning phase.
            mirror: (2, seeds, width) of all seeds: the first half of the rows of each minibatch,
                which are in random order, becomes gain * rows + offset; None to mirror none.
        """
        self.seeds, self._group = group.seeds, group
        self._learner, self._generators, self._replay = group.learner, group.generators, replay
        self._size, self._gamma = settings.batch_size, settings.gamma
        self._terminal = time_limit == "terminal"
        self._rows = replay.seed_rows(group.seeds)
        scratch, width = group.learner.view.scratch, self._rows.shape[-1]
        rows, next_rows = (scratch(name, self._size, width) for name in ("rows", "next_rows"))
        self._mirrored = (rows[..., : self._size // 2, :], next_rows[..., : self._size // 2, :])
        self._mirror = mirror
        if mirror is not None:
            mirror = mirror[:, group.seeds.start : group.seeds.stop]
            self._mirror = mirror.reshape(2, *group.learner.view.batch_shape, 1, width)
        self._together = min(_RECORDED, updates) if group.learner.view.is_stack else 1
        self._noise = self._buffer(group.learner.noise_per_transition)
        self._discounts = self._buffer(1).fill_(self._gamma)
        self._indices, self._next_indices = (self._buffer(dtype=torch.int64) for _ in range(2))
        self._batches = [
            Batch(rows, next_rows, *numbers, self._learner.action_size)
            for numbers in zip(self._discounts, self._noise, strict=True)
        ]
        # The minibatch rows of each update, and the indices of the replay buffer's rows.
        self._gathered = [
            (
                (rows.view(-1, width), indices.view(-1)),
                (next_rows.view(-1, width), next_indices.view(-1)),
            )
            for indices, next_indices in zip(self._indices, self._next_indices, strict=True)
        ]
        self._update = Captured(self._rows.device)
        self._pretrain = Captured(self._rows.device)
        self._delayed: list[bool] = []
        self._samples: list[tuple[Tensor, Tensor]] = []

    def pretrain(self, control_steps: int) -> None:
        """Makes the updates that precede the first update of the agents."""
        remaining = self._learner.pretraining(control_steps)
        while remaining:
            count = min(remaining, _MAX_SAMPLED)
            samples = self._sample(count)
            for i in range(count):
                self._put(samples, slice(i, i + 1))
                self._pretrain(self._pretrain_once, None)
            remaining -= count

    def prepare(self, first: int, count: int) -> None:
        """Samples indices and noise for the next `count` updates.

        Args:
            first: number of the first update since the start of training, counted from 1.
        """
        self._delayed = [self._learner.is_delayed_update(first + i, i) for i in range(count)]
        self._samples = self._sample(count)

    def run(self) -> None:
        """Makes the updates that were prepared."""
        self._learner.reset_losses(self._delayed)
        for first in range(0, len(self._delayed), self._together):
            some = slice(first, first + self._together)
            self._put(self._samples, some)
            self._update(self._update_some, tuple(self._delayed[some]))

    def _buffer(self, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns zeros (updates of a graph, ..., size, *shape)."""
        rows, batch_shape = self._rows, self._learner.view.batch_shape
        full = (self._together, *batch_shape, self._size, *shape)
        return torch.zeros(full, dtype=dtype or rows.dtype, device=rows.device)

    def _put(self, samples: Sequence[tuple[Tensor, Tensor]], some: slice) -> None:
        """Copies the indices and noise of some updates to the buffers that they read."""
        for buffer, values in samples:
            chosen = values[some]
            buffer[: len(chosen)].copy_(chosen)

    def _update_some(self, delayed: Hashable) -> None:
        """Makes updates with the indices and noise in the buffers.

        Args:
            delayed: for each update, whether it includes the delayed ones.
        """
        assert isinstance(delayed, tuple)
        for i, is_delayed in enumerate(delayed):
            self._gather(i)
            self._learner.update(self._batches[i], is_delayed)

    def _pretrain_once(self, _: Hashable) -> None:
        """Trains features on the minibatch whose indices are in the first buffer."""
        self._gather(0)
        self._learner.pretrain(self._batches[0])

    def _gather(self, update: int) -> None:
        for rows, indices in self._gathered[update]:
            torch.index_select(self._rows, 0, indices, out=rows)
        if self._mirror is not None:
            gain, offset = self._mirror
            for half in self._mirrored:
                torch.addcmul(offset, half, gain, out=half)

    def _sample(self, count: int) -> list[tuple[Tensor, Tensor]]:
        """Returns buffers (any, ..., size, any), each with samples (count, ..., size, any)."""
        shape, noise = (count, self._size), self._noise
        sampled = [self._replay.sample(seed.updates, *shape) for seed in self._generators]
        stack, seed_rows = self._group.stack, len(self._rows) // len(sampled)
        samples = [
            (self._indices, stack([indices.rows for indices in sampled], seed_rows)),
            (self._next_indices, stack([indices.next_rows for indices in sampled], seed_rows)),
        ]
        if self._terminal:
            discounts = [np.where(indices.last, 0, self._gamma)[..., None] for indices in sampled]
            samples.append((self._discounts, stack(discounts)))
        if noise.shape[-1]:
            size = (*shape, noise.shape[-1])
            normal = [seed.updates.standard_normal(size, np.float32) for seed in self._generators]
            samples.append((noise, stack(normal)))
        return samples
