"""A forward model: latents that, with the actions, determine what happens next.

The encoder has the shape of the denoising autoencoder's, one tanh layer, so that the two differ in
their loss alone. A hidden tanh layer predicts from latents and actions how the state changes over
`horizon` control steps, and the mean reward on the way. Each of these numbers is scaled to unit
variance: what varies most is not what counts.

Source: the task "predict the difference of states" of Lange et al. (arXiv:2310.04241), with the
reward.
"""

from typing import TYPE_CHECKING, ClassVar

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.kind import Batch, Learned, Weights, tanh
from jbench.encoders.kinds.vae import affine, layers
from jbench.encoders.moments import Moments
from jbench.names import EPISODE_STEPS
from jbench.tasks.features import FEATURE_SIZES, RANGES, TASK_SPECS, Array

if TYPE_CHECKING:
    from jbench.encoders.states import States

_CONSTANT = 1e-9  # standard deviation of a change that never happens
_ROWS = 65536  # at a time


class ForwardModel(Learned):
    """Predicts the changes of the state and the reward."""

    uses_actions: ClassVar[bool] = True

    hidden: int = Field(default=64, ge=1, description="units of the predictor; ours")
    horizon: int = Field(default=1, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    @property
    def steps_ahead(self) -> int:
        """Control steps over which the state changes."""
        return self.horizon

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns Glorot's weights, and biases of 0."""
        return layers(
            {
                "encoder": (latents, size),
                "hidden": (self.hidden, latents + self.horizon),
                "change": (size, self.hidden),
                "reward": (1, self.hidden),
                "decoder": (size, latents),
            },
            random,
        )

    def constants(self, states: "States") -> dict[str, Tensor]:
        """Returns what scales changes and rewards to unit variance, and the turns of angles."""
        turn = full_turns(states)
        of_changes, of_rewards = Moments.none(states.size), Moments.none(1)
        for shard in states.learn():
            for chosen in torch.arange(shard.pairs(self.horizon)).split(_ROWS):
                batch = shard.take(chosen.to(states.device), self.horizon, with_actions=True)
                changes = changes_of(batch, turn.to(states.device))
                of_changes = of_changes.merged(Moments.of(changes.cpu().numpy()))
                assert batch.rewards is not None
                of_rewards = of_rewards.merged(
                    Moments.of(batch.rewards.mean(1, True).cpu().numpy())
                )
        found = {
            "change.turn": turn,
            "change.scale": _inverse_sd(of_changes),
            "reward.scale": _inverse_sd(of_rewards),
        }
        return {name: value.to(states.device) for name, value in found.items()}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents, in (-1, 1)."""
        return tanh(affine(weights, "encoder", scaled))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction, which is learned beside the predictions."""
        return affine(weights, "decoder", latents)

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the mean squared errors of changes, of the reward and of the reconstruction.

        The reconstruction has no influence on the latents.
        """
        assert batch.actions is not None and batch.rewards is not None  # noqa: PT018
        latents = self.encode(weights, batch.now)
        hidden = tanh(affine(weights, "hidden", torch.cat([latents, batch.actions], 1)))
        changes = changes_of(batch, weights["change.turn"]) * weights["change.scale"]
        rewards = batch.rewards.mean(1, keepdim=True) * weights["reward.scale"]
        rebuilt = self.decode(weights, latents.detach())
        mse = torch.nn.functional.mse_loss
        return (
            mse(affine(weights, "change", hidden), changes)
            + mse(affine(weights, "reward", hidden), rewards)
            + mse(rebuilt, batch.now)
        )


def changes_of(batch: Batch, turn: Tensor) -> Tensor:
    """Returns the (rows, size) changes of the scaled features, those of angles the shorter way.

    Args:
        batch: pairs of states.
        turn: (size,) as `full_turns` returns it.
    """
    change = batch.later - batch.now
    return change - turn * torch.where(turn > 0, change / turn, 0).round()


def full_turns(states: "States") -> Tensor:
    """Returns the (size,) widths of a full turn of the features that are angles, scaled; else 0."""
    names = TASK_SPECS[states.task].features
    angle = [name for name in names for _ in range(FEATURE_SIZES[name])]
    observed = np.array([2.0 * (RANGES[name][1] == (np.pi,)) for name in angle], np.float32)
    return torch.from_numpy(observed * states.scaling.gain_and_offset()[0])


def _inverse_sd(moments: Moments) -> Tensor:
    """Returns 1 / standard deviation of each column, and 0 for one that does not vary."""
    sd = np.sqrt(moments.variance)
    inverse = np.divide(1, sd, out=np.zeros_like(sd), where=sd > _CONSTANT)
    return torch.from_numpy(inverse.astype(np.float32))
