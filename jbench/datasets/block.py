"""Episodes of a dataset, with the observations and rewards of one task."""

from typing import NamedTuple

import numpy as np

from jbench.array_types import BoolArray, Float32Array, IntArray


class Block(NamedTuple):
    """Episodes of up to n control steps; what is after the end of an episode is 0.

    Attributes:
        observations: (episodes, n + 1, dim(O)) in float32, the last one after the last action.
        actions: (episodes, n) in float32 of the Jitterbug, whose actions are numbers; of another
            robot as `action_vectors`.
        rewards: (episodes, n) in float32, at the end of each control step.
        lengths: (episodes,) control steps of each episode.
        terminated: (episodes,) whether an episode terminated; otherwise it was truncated.
    """

    observations: Float32Array
    actions: Float32Array
    rewards: Float32Array
    lengths: IntArray
    terminated: BoolArray

    @classmethod
    def truncated(
        cls,
        observations: Float32Array,
        actions: Float32Array,
        rewards: Float32Array,
    ) -> "Block":
        """Returns episodes that were all truncated at the time limit, after n control steps."""
        count, length = rewards.shape
        return cls(
            observations,
            actions,
            rewards,
            lengths=np.full(count, length),
            terminated=np.zeros(count, bool),
        )

    def only(self, chosen: BoolArray) -> "Block":
        """Returns some of the episodes, by a mask (episodes,)."""
        return Block(
            observations=self.observations[chosen],
            actions=self.actions[chosen],
            rewards=self.rewards[chosen],
            lengths=self.lengths[chosen],
            terminated=self.terminated[chosen],
        )

    @property
    def action_vectors(self) -> Float32Array:
        """The actions of any robot, (episodes, n, action_size)."""
        return self.actions if self.actions.ndim == 3 else self.actions[..., None]

    @property
    def states(self) -> Float32Array:
        """The observations (rows, dim(O)) of all episodes, one after another."""
        return self.observations[self._is_state]

    @property
    def followed(self) -> IntArray:
        """The number of observations that follow each of `states` in its episode, (rows,)."""
        steps = np.arange(self.observations.shape[1])
        return (self.lengths[:, None] - steps)[self._is_state]

    def in_a_row(
        self,
    ) -> tuple[Float32Array, Float32Array, Float32Array, IntArray]:
        """Returns `states`, the action vector and reward of each, and `followed`, all (rows, ...).

        Action and reward are 0 in the last state of an episode.
        """
        actions, rewards = (
            np.concatenate([made, np.zeros_like(made[:, :1])], axis=1)[self._is_state]
            for made in (self.action_vectors, self.rewards)
        )
        return self.states, actions, rewards, self.followed

    @property
    def _is_state(self) -> BoolArray:
        """Which steps of the observations are states of an episode, (episodes, n + 1)."""
        steps = np.arange(self.observations.shape[1])
        return np.asarray(steps <= self.lengths[:, None])
