"""Off-policy updates: each seed draws its minibatches, each group of seeds learns from them."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.replay import ReplayBuffer
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.team import Group
from jbench.names import TimeLimit
from jbench.settings.algorithms import OffPolicySettings

_DRAWN = 1000  # minibatches before the first update, at a time


class Updates:
    """The updates of one group of seeds.

    Random numbers are drawn on the CPU for all updates that are due at a time; then each update
    finds its own in the same memory, so that a GPU can repeat it without Python.

    Attributes:
        seeds: their places.
    """

    def __init__(
        self,
        settings: OffPolicySettings,
        group: Group[OffPolicyLearner],
        streams: Sequence[Streams],
        replay: ReplayBuffer,
        time_limit: TimeLimit,
    ) -> None:
        """Makes none yet.

        Args:
            settings: of the algorithm.
            group: that learns.
            streams: of the seeds of the group.
            replay: the buffers of all seeds.
            time_limit: whether the value of an episode's last state counts.
        """
        self.seeds = group.seeds
        self._learner, self._streams, self._replay = group.learner, streams, replay
        self._size, self._gamma = settings.batch_size, settings.gamma
        self._terminal = time_limit == "terminal"
        self._rows = replay.rows_of(group.seeds)
        scratch, width = group.learner.part.scratch, self._rows.shape[-1]
        self._batch = batch = Batch(
            scratch("rows", self._size, width),
            scratch("next_rows", self._size, width),
            scratch("discounts", self._size, 1).fill_(self._gamma),
            scratch("noise", self._size, group.learner.noise_per_transition),
        )
        self._places, self._next_places = (
            scratch(name, self._size, dtype=torch.int64) for name in ("places", "next_places")
        )
        # Where rows are found, and where they are put.
        self._gathered = [
            (places.view(-1), rows.view(-1, width))
            for places, rows in (
                (self._places, batch.rows),
                (self._next_places, batch.next_rows),
            )
        ]
        self._update = Captured(self._update_once, self._rows.device)
        self._pretrain = Captured(self._pretrain_once, self._rows.device)
        self._delayed: list[bool] = []
        self._samples: list[tuple[Tensor, Tensor]] = []

    def pretrain(self, control_steps: int) -> None:
        """Learns what is to be learned before the first update.

        Args:
            control_steps: of each seed.
        """
        left = self._learner.pretraining(control_steps)
        while left:
            count = min(left, _DRAWN)
            samples = self._draw(count)
            for i in range(count):
                self._put(samples, i)
                self._pretrain(None)
            left -= count

    def prepare(self, first: int, count: int) -> None:
        """Samples indices and noise for a number of updates.

        Args:
            first: number of the first of them, counted from 1.
            count: how many.
        """
        self._delayed = [self._learner.is_delayed_update(first + i, i) for i in range(count)]
        self._samples = self._draw(count)

    def run(self) -> None:
        """Makes the updates that were prepared."""
        self._learner.reset_losses(self._delayed)
        for i, delayed in enumerate(self._delayed):
            self._put(self._samples, i)
            self._update(delayed)

    def _put(self, samples: Sequence[tuple[Tensor, Tensor]], update: int) -> None:
        """Copies the indices and noise of one update to where it reads them."""
        for place, drawn in samples:
            place.copy_(drawn[update])

    def _update_once(self, delayed: Hashable) -> None:
        """Makes one update with the indices and noise in memory."""
        self._gather()
        self._learner.update(self._batch, bool(delayed))

    def _pretrain_once(self, _: Hashable) -> None:
        """Learns features from the minibatch whose indices are in memory."""
        self._gather()
        self._learner.pretrain(self._batch)

    def _gather(self) -> None:
        for places, rows in self._gathered:
            torch.index_select(self._rows, 0, places, out=rows)

    def _draw(self, count: int) -> list[tuple[Tensor, Tensor]]:
        """Returns places (..., size, any) for samples, each with (count, ..., size, any) of it."""
        shape, noise = (count, self._size), self._batch.noise
        drawn = [self._replay.draw(stream.updates, *shape) for stream in self._streams]
        samples = [
            (self._places, self._together([draws.rows for draws in drawn], offset=True)),
            (self._next_places, self._together([draws.next_rows for draws in drawn], offset=True)),
        ]
        if self._terminal:
            discounts = [np.where(draws.last, 0, self._gamma)[..., None] for draws in drawn]
            samples.append((self._batch.discounts, self._together(discounts)))
        if noise.shape[-1]:
            size = (*shape, noise.shape[-1])
            normal = [stream.updates.standard_normal(size, np.float32) for stream in self._streams]
            samples.append((noise, self._together(normal)))
        return samples

    def _together(self, of_each: Sequence[NDArray[Any]], *, offset: bool = False) -> Tensor:
        """Puts what each seed drew, (count, ...), in the layout of the group, on its device.

        Args:
            of_each: of each seed.
            offset: whether these are rows of a seed's own buffer.
        """
        if not self._learner.part.lead:
            return torch.from_numpy(of_each[0])
        if offset:
            rows = len(self._rows) // len(of_each)
            of_each = [drawn + seed * rows for seed, drawn in enumerate(of_each)]
        return torch.from_numpy(np.stack(of_each, axis=1)).to(self._rows.device)
