"""Off-policy updates: sampling minibatches per seed and updating each group of seeds."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from jbench.agents.batched.engine import SeedGroup
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.normalize import RunningStatistics
from jbench.agents.batched.replay import Batch, ReplayBuffer
from jbench.settings.algorithms import OffPolicySettings

_MAX_SAMPLED = 1000  # minibatches of pretraining that are sampled at once


class _Sampled(NamedTuple):
    """What was sampled for some updates, and the buffer from which each reads its own.

    Attributes:
        buffer: (..., batch, any).
        values: (updates, ..., batch, any).
    """

    buffer: Tensor
    values: Tensor


class Updates:
    """The updates of one group of seeds.

    Random numbers for all updates of a learning phase are drawn on the CPU at once. Each update
    then reads its own from the same buffers, so that a GPU can replay it as a CUDA graph.
    """

    def __init__(
        self,
        settings: OffPolicySettings,
        group: SeedGroup[OffPolicyLearner[Any]],
        replay: ReplayBuffer,
        *,
        mirror: Tensor | None = None,
        statistics: RunningStatistics | None = None,
    ) -> None:
        """Makes the buffers.

        The first half of the rows of each minibatch, which are in random order, becomes gain * rows
        + offset, if `mirror` (2, seeds, width) of all seeds is given. Then observations and next
        observations are standardized by the newest `statistics`, if they are given.
        """
        self.group = group
        self._learner = group.learner
        self._replay = replay
        self._size = settings.batch_size
        self._gamma = settings.gamma
        self._source = replay.seed_rows(group.seeds)

        view = group.learner.view
        size = settings.batch_size
        width = self._source.shape[-1]
        self._indices = view.scratch("indices", size, dtype=torch.int64)
        self._next_indices = view.scratch("next_indices", size, dtype=torch.int64)
        batch = Batch(
            view.scratch("rows", size, width),
            view.scratch("next_rows", size, width),
            view.scratch("discounts", size, 1).fill_(self._gamma),
            view.scratch("noise", size, group.learner.noise_per_transition),
            group.learner.action_size,
        )
        self._batch = batch
        gathered = (batch.rows, self._indices), (batch.next_rows, self._next_indices)
        self._gathered = [(rows.view(-1, width), indices.view(-1)) for rows, indices in gathered]
        self._mirrored = [rows[..., : size // 2, :] for rows in (batch.rows, batch.next_rows)]

        self._mirror = mirror
        if mirror is not None:
            mirror = mirror[:, group.seeds.start : group.seeds.stop]
            self._mirror = mirror.reshape(2, *view.batch_shape, 1, width)
        self._standardization = None
        if statistics is not None:
            self._standardization = statistics.group_standardization(
                group.seeds, is_stack=view.is_stack
            )
        self._update = Captured(self._source.device)
        self._delayed: list[bool] = []
        self._sampled: list[_Sampled] = []

    def pretrain(self, updates: int) -> None:
        """Makes updates of the features alone, which precede the first update of the agents."""
        remaining = updates
        while remaining:
            count = min(remaining, _MAX_SAMPLED)
            sampled = self._sample(count)
            for update in range(count):
                _write_to_buffers(sampled, update)
                self._update(self._update_once, None)
            remaining -= count

    def prepare(self, first: int, count: int) -> None:
        """Samples indices and noise for `count` updates from number `first` on, counted from 1."""
        self._delayed = [self._learner.is_delayed_update(first + i, i) for i in range(count)]
        self._sampled = self._sample(count)

    def run(self) -> None:
        """Makes the updates that were prepared."""
        self._learner.reset_losses(self._delayed)
        for update, delayed in enumerate(self._delayed):
            _write_to_buffers(self._sampled, update)
            self._update(self._update_once, delayed)

    def _update_once(self, delayed: bool | None) -> None:
        """Updates the agents on the sampled minibatch, or for None only their features."""
        for rows, indices in self._gathered:
            torch.index_select(self._source, 0, indices, out=rows)
        if self._mirror is not None:
            gain, offset = self._mirror
            for half in self._mirrored:
                torch.addcmul(offset, half, gain, out=half)
        if self._standardization is not None:
            self._standardization.apply_in_place(self._batch.observations)
            self._standardization.apply_in_place(self._batch.next_observations)
        if delayed is None:
            self._learner.pretrain(self._batch)
        else:
            self._learner.update(self._batch, delayed)

    def _sample(self, count: int) -> list[_Sampled]:
        """Returns the indices, discounts and noise of the minibatches of `count` updates."""
        noise = self._batch.noise
        generators = [seed.updates for seed in self.group.generators]
        of_seeds = [
            self._replay.sample(generator, count, self._size, seed)
            for seed, generator in zip(self.group.seeds, generators, strict=True)
        ]
        stack = self.group.stack
        seed_rows = len(self._source) // len(of_seeds)
        rows = stack([each.rows for each in of_seeds], seed_rows)
        next_rows = stack([each.next_rows for each in of_seeds], seed_rows)
        sampled = [_Sampled(self._indices, rows), _Sampled(self._next_indices, next_rows)]
        if self._replay.has_terminals:
            discounts = [np.where(each.is_terminal, 0, self._gamma)[..., None] for each in of_seeds]
            sampled.append(_Sampled(self._batch.discounts, stack(discounts)))
        if noise.shape[-1]:
            shape = (count, self._size, noise.shape[-1])
            normal = [generator.standard_normal(shape, np.float32) for generator in generators]
            sampled.append(_Sampled(noise, stack(normal)))
        return sampled


def _write_to_buffers(sampled: Sequence[_Sampled], update: int) -> None:
    """Copies the indices, discounts and noise of an update to the buffers that it reads."""
    for buffer, values in sampled:
        buffer.copy_(values[update])
