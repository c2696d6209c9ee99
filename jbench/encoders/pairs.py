"""Whole episodes of scaled states, and the pairs of states that encoders are trained on."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

MAX_PAIRS = 65536
"""Most rows that are in memory at a time where states are read in blocks."""


class StatePairs(NamedTuple):
    """Training rows of scaled features."""

    now: Tensor  # (rows, size) states to encode, corrupted by some kinds
    later: Tensor  # (rows, size) clean states `steps_ahead` control steps later
    actions: Any = None  # (rows, steps_ahead * action_size), if the kind uses actions
    noise: Any = None  # (rows, latents) standard normal, of random latents
    rewards: Any = None  # (rows, steps_ahead), if the kind uses actions

    def split(self, rows: int) -> list["StatePairs"]:
        """Returns parts of this many rows; the last one may be smaller."""
        none = [None] * -(-len(self.now) // rows)
        parts = [none if part is None else part.split(rows) for part in self]
        return [StatePairs(*part) for part in zip(*parts, strict=True)]


class Followed:
    """How many states follow each state in its episode, where lengths of episodes differ."""

    def __init__(self, counts: Tensor) -> None:
        """Takes the numbers of states, (states,)."""
        self.counts = counts
        self._starts: dict[int, Tensor] = {}

    def starts(self, ahead: int) -> Tensor:
        """Returns the rows of states that at least `ahead` states follow; found once."""
        if ahead not in self._starts:
            self._starts[ahead] = (self.counts >= ahead).nonzero()[:, 0]
        return self._starts[ahead]

    def to(self, device: torch.device) -> "Followed":
        """Returns a copy on a device."""
        return Followed(self.counts.to(device))


class Shard(NamedTuple):
    """Whole episodes: of one length, or one after another in a row.

    In the latter case `episodes` is 1, and `followed` is given; then each state has an action and
    a reward, which are 0 for the last state of an episode.
    """

    states: Tensor  # (episodes, steps + 1, size) scaled: one before each action, and the last
    actions: Tensor  # (episodes, steps, action_size)
    rewards: Tensor  # (episodes, steps) of the actions
    followed: Followed | None = None

    def pairs(self, ahead: int) -> int:
        """Returns the number of pairs of states `ahead` steps apart."""
        if self.followed is not None:
            return len(self.followed.starts(ahead))
        return len(self.states) * (self.states.shape[1] - ahead)

    def take(self, indices: Tensor, ahead: int, with_actions: bool = False) -> StatePairs:
        """Returns pairs of states by index (rows,), counted through all episodes."""
        states = self.states.view(-1, self.states.shape[-1])

        if self.followed is not None:
            rows = self.followed.starts(ahead)[indices]
            now = states.index_select(0, rows)
            if not ahead:
                return StatePairs(now, now)

            batch = StatePairs(now, states.index_select(0, rows + ahead))
            if not with_actions:
                return batch
            return self._with_actions(batch, rows, ahead)

        if not ahead:
            now = states.index_select(0, indices)
            return StatePairs(now, now)

        episode = indices // (self.states.shape[1] - ahead)
        rows = indices + episode * ahead
        batch = StatePairs(states.index_select(0, rows), states.index_select(0, rows + ahead))
        if not with_actions:
            return batch
        return self._with_actions(batch, rows - episode, ahead)

    def first(self, episodes: int) -> "Shard":
        """Returns the first of these episodes, up to a number."""
        if self.followed is None:
            return Shard(self.states[:episodes], self.actions[:episodes], self.rewards[:episodes])

        ends = (self.followed.counts == 0).nonzero()[:, 0]
        count = int(ends[min(episodes, len(ends)) - 1]) + 1
        states, actions, rewards = (part[:, :count] for part in self[:3])
        return Shard(states, actions, rewards, Followed(self.followed.counts[:count]))

    def _with_actions(self, batch: StatePairs, rows: Tensor, ahead: int) -> StatePairs:
        """Returns pairs with `ahead` actions and rewards, from these (rows,) on."""
        steps = rows[:, None] + torch.arange(ahead, device=rows.device)
        actions = self.actions.flatten(0, 1)[steps].flatten(1)
        return batch._replace(actions=actions, rewards=self.rewards.view(-1)[steps])

    def only(self, columns: Sequence[int]) -> "Shard":
        """Returns a copy with some of the features."""
        return self._replace(states=self.states[..., list(columns)])

    def to(self, device: torch.device) -> "Shard":
        """Returns a copy on a device."""
        states, actions, rewards = (part.to(device) for part in self[:3])
        if self.followed is None:
            return Shard(states, actions, rewards)
        return Shard(states, actions, rewards, self.followed.to(device))


def state_pairs(
    shards: Iterable[Shard], ahead: int, with_actions: bool = False
) -> Iterator[StatePairs]:
    """Yields all pairs of states `ahead` steps apart, up to 65,536 at a time."""
    for shard in shards:
        indices = torch.arange(shard.pairs(ahead), device=shard.states.device)
        for some in indices.split(MAX_PAIRS):
            yield shard.take(some, ahead, with_actions)
