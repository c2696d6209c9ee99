"""A minibatch of an off-policy update."""

import torch
from torch import Tensor


class Batch:
    """Transitions (s, a, r, s') in reused buffers; a stack of seeds has a leading axis.

    Attributes:
        rows: (..., batch, dim(O) + dim(A) + 1) s, a and r; the next four attributes are views of
            it.
        state_actions: (..., batch, dim(O) + dim(A)) s and a, the input of a critic.
        observations: (..., batch, dim(O)) s.
        actions: (..., batch, dim(A)) a; overwritten by an update.
        rewards: (..., batch, 1) r.
        next_rows: (..., batch, dim(O) + dim(A) + 1) s' and unused columns.
        next_state_actions: (..., batch, dim(O) + dim(A)) s' and the next action.
        next_observations: (..., batch, dim(O)) s'.
        next_actions: (..., batch, dim(A)) written by an update.
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
        """Makes the views of the given buffers."""
        size = rows.shape[-1] - action_size - 1
        self.rows, self.next_rows = rows, next_rows
        self.discounts, self.noise = discounts, noise
        self.state_actions, self.rewards = rows[..., :-1], rows[..., -1:]
        self.observations, self.actions = rows[..., :size], rows[..., size:-1]
        self.next_state_actions = next_rows[..., :-1]
        self.next_observations, self.next_actions = next_rows[..., :size], next_rows[..., size:-1]
        self.mean_weight = torch.full_like(discounts, 1 / rows.shape[-2])
