"""Scaled episodes, and the pairs of their states that encoders are trained on."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor

from jbench.names import EPISODE_STEPS

STATES = EPISODE_STEPS + 1
"""States of an episode: one before each action, and the last."""

_MAX_PAIRS = 65536  # in a block


class StatePairs(NamedTuple):
    """Training rows with features scaled to [-1, 1].

    Attributes:
        now: (rows, size) states to encode, corrupted by some kinds.
        later: (rows, size) clean states `steps_ahead` control steps later.
        actions: (rows, steps_ahead) between the two; None unless the kind uses actions.
        noise: (rows, latents) standard normal numbers of kinds with random latents; else None.
        rewards: (rows, steps_ahead) of the actions; None unless the kind uses actions.
    """

    now: Tensor
    later: Tensor
    actions: Tensor | None = None
    noise: Tensor | None = None
    rewards: Tensor | None = None

    def split(self, rows: int) -> list["StatePairs"]:
        """Returns parts of this many rows; the last one may be smaller."""
        none = [None] * -(-len(self.now) // rows)
        parts = [none if part is None else part.split(rows) for part in self]
        return [StatePairs(*part) for part in zip(*parts, strict=True)]


class Shard(NamedTuple):
    """Whole episodes.

    Attributes:
        states: (episodes, 1001, size) scaled.
        actions: (episodes, 1000), or (episodes, 1000, action_size) of another robot.
        rewards: (episodes, 1000) of the actions.
    """

    states: Tensor
    actions: Tensor
    rewards: Tensor

    def pairs(self, ahead: int) -> int:
        """Returns the number of pairs of states `ahead` steps apart."""
        return len(self.states) * (STATES - ahead)

    def take(self, indices: Tensor, ahead: int, with_actions: bool = False) -> StatePairs:
        """Returns pairs of states by index (rows,), counted through all episodes."""
        states = self.states.view(-1, self.states.shape[-1])
        if not ahead:
            now = states.index_select(0, indices)
            return StatePairs(now, now)
        episode = indices // (STATES - ahead)
        rows = indices + episode * ahead
        batch = StatePairs(states.index_select(0, rows), states.index_select(0, rows + ahead))
        if not with_actions:
            return batch
        steps = (rows - episode)[:, None] + torch.arange(ahead, device=rows.device)
        actions = self.actions.flatten(0, 1)[steps].flatten(1)
        return batch._replace(actions=actions, rewards=self.rewards.view(-1)[steps])

    def blocks(self, ahead: int, with_actions: bool = False) -> Iterator[StatePairs]:
        """Yields all pairs of states `ahead` steps apart, up to 65,536 at a time."""
        for indices in torch.arange(self.pairs(ahead), device=self.states.device).split(_MAX_PAIRS):
            yield self.take(indices, ahead, with_actions)

    def to(self, device: torch.device) -> "Shard":
        """Returns a copy on a device."""
        return Shard(*(part.to(device) for part in self))
