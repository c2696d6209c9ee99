"""Episodes of a dataset, with the observations and rewards of one task."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


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

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]
    lengths: NDArray[np.int64]
    terminated: NDArray[np.bool_]

    @classmethod
    def truncated(
        cls,
        observations: NDArray[np.float32],
        actions: NDArray[np.float32],
        rewards: NDArray[np.float32],
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

    def only(self, chosen: NDArray[np.bool_]) -> "Block":
        """Returns some of the episodes, by a mask (episodes,)."""
        return Block(
            observations=self.observations[chosen],
            actions=self.actions[chosen],
            rewards=self.rewards[chosen],
            lengths=self.lengths[chosen],
            terminated=self.terminated[chosen],
        )

    @property
    def action_vectors(self) -> NDArray[np.float32]:
        """The actions of any robot, (episodes, n, action_size)."""
        return self.actions if self.actions.ndim == 3 else self.actions[..., None]

    @property
    def states(self) -> NDArray[np.float32]:
        """The observations (rows, dim(O)) of all episodes, one after another."""
        return self.observations[self._is_state]

    @property
    def followed(self) -> NDArray[np.int64]:
        """The number of observations that follow each of `states` in its episode, (rows,)."""
        steps = np.arange(self.observations.shape[1])
        return (self.lengths[:, None] - steps)[self._is_state]

    def in_a_row(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        """Returns `states`, the action vector and reward of each, and `followed`, all (rows, ...).

        Action and reward are 0 in the last state of an episode.
        """
        actions, rewards = (
            np.concatenate([made, np.zeros_like(made[:, :1])], axis=1)[self._is_state]
            for made in (self.action_vectors, self.rewards)
        )
        return self.states, actions, rewards, self.followed

    @property
    def _is_state(self) -> NDArray[np.bool_]:
        """Which steps of the observations are states of an episode, (episodes, n + 1)."""
        steps = np.arange(self.observations.shape[1])
        return np.asarray(steps <= self.lengths[:, None])
