"""A forward model: latents that predict the change of the state and the reward.

From latents and actions it predicts the change of the state over `horizon` control steps and the
mean reward. Every target is scaled to unit variance, so that features of large variance do not
dominate the loss.

Source: the task "predict the difference of states" of Lange et al. (arXiv:2310.04241), with the
reward.
"""

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Weights, affine
from jbench.encoders.kinds.predictive import Predictive
from jbench.encoders.moments import Moments
from jbench.tasks.features import FEATURE_SIZES, RANGES, TASK_SPECS

if TYPE_CHECKING:
    from jbench.encoders.states import States

_MIN_SD = 1e-9  # changes of smaller standard deviation count as constant


class ForwardModel(Predictive):
    """Predicts the changes of the state and the reward."""

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Returns the layers that predict the changes and the reward."""
        return {"change": (size, self.hidden), "reward": (1, self.hidden)}

    def constants(self, states: "States") -> dict[str, Tensor]:
        """Returns the scales of changes and rewards, and the periods of angles."""
        periods = angle_periods(states)
        change_moments, reward_moments = Moments.none(states.size), Moments.none(1)
        for shard in states.learn():
            for batch in shard.blocks(self.horizon, with_actions=True):
                changes = changes_of(batch, periods.to(states.device))
                change_moments = change_moments.merged(Moments.of(changes.cpu().numpy()))
                assert batch.rewards is not None
                reward_moments = reward_moments.merged(
                    Moments.of(batch.rewards.mean(1, True).cpu().numpy())
                )
        constants = {
            "change.turn": periods,
            "change.scale": _inverse_sd(change_moments),
            "reward.scale": _inverse_sd(reward_moments),
        }
        return {name: value.to(states.device) for name, value in constants.items()}

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the sum of the mean squared errors of changes, reward and reconstruction."""
        assert batch.rewards is not None
        latents = self.encode(weights, batch.now)
        hidden = self.hidden_units(weights, latents, batch)
        changes = changes_of(batch, weights["change.turn"]) * weights["change.scale"]
        rewards = batch.rewards.mean(1, keepdim=True) * weights["reward.scale"]
        mse = torch.nn.functional.mse_loss
        return (
            mse(affine(weights, "change", hidden), changes)
            + mse(affine(weights, "reward", hidden), rewards)
            + self.reconstruction_error(weights, latents, batch)
        )


def changes_of(batch: Batch, periods: Tensor) -> Tensor:
    """Returns the (rows, size) changes of the scaled features; angles change the shorter way.

    Args:
        periods: (size,) from `angle_periods`.
    """
    change = batch.later - batch.now
    return change - periods * torch.where(periods > 0, change / periods, 0).round()


def angle_periods(states: "States") -> Tensor:
    """Returns the (size,) scaled periods of the features: a full turn of an angle, otherwise 0.

    Which features of another robot are angles is not known.
    """
    if states.task not in TASK_SPECS:
        return torch.zeros(states.size)
    names = TASK_SPECS[states.task].features
    labels = [name for name in names for _ in range(FEATURE_SIZES[name])]
    periods = np.array([2.0 * (RANGES[name][1] == (np.pi,)) for name in labels], np.float32)
    return torch.from_numpy(periods * states.scaling.gain_and_offset()[0])


def _inverse_sd(moments: Moments) -> Tensor:
    """Returns 1 / standard deviation of each column; 0 for a constant column."""
    sd = np.sqrt(moments.variance)
    inverse = np.divide(1, sd, out=np.zeros_like(sd), where=sd > _MIN_SD)
    return torch.from_numpy(inverse.astype(np.float32))
