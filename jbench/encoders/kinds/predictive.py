"""The layers that `forward`, `inverse` and `contrastive` share; they differ in their loss.

The encoder is one tanh layer, as in the denoising autoencoder. A hidden tanh layer sees the latents
of a state and the actions of the next `horizon` control steps. A linear decoder reconstructs the
state, without influence on the latents.
"""

from abc import abstractmethod
from typing import ClassVar

import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Learned, Weights, affine, layers, tanh
from jbench.names import EPISODE_STEPS
from jbench.tasks.features import Array


class Predictive(Learned):
    """Learns latents from which the future can be predicted."""

    uses_actions: ClassVar[bool] = True

    hidden: int = Field(default=64, ge=1, description="units of the predictor; ours")
    horizon: int = Field(default=1, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    @property
    def steps_ahead(self) -> int:
        """Control steps between a state and the later one."""
        return self.horizon

    @abstractmethod
    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Returns the (outputs, inputs) of the layers after the hidden layer.

        Args:
            actions: numbers of the actions of `horizon` control steps.
        """

    def hidden_inputs(self, latents: int, actions: int) -> int:
        """Returns the number of inputs of the hidden layer, by default latents and actions."""
        return latents + actions

    def initial(
        self, size: int, latents: int, random: torch.Generator, action_size: int = 1
    ) -> dict[str, Tensor]:
        """Returns Glorot weights and zero biases."""
        actions = self.horizon * action_size
        return layers(
            {
                "encoder": (latents, size),
                "hidden": (self.hidden, self.hidden_inputs(latents, actions)),
                **self.heads(size, latents, actions),
                "decoder": (size, latents),
            },
            random,
        )

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents, in (-1, 1)."""
        return tanh(affine(weights, "encoder", scaled))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction."""
        return affine(weights, "decoder", latents)

    def hidden_units(self, weights: Weights, latents: Tensor, batch: Batch) -> Tensor:
        """Returns the (rows, hidden) activations for the latents and actions of a batch."""
        assert batch.actions is not None
        units: Tensor = tanh(affine(weights, "hidden", torch.cat([latents, batch.actions], 1)))
        return units

    def reconstruction_error(self, weights: Weights, latents: Tensor, batch: Batch) -> Tensor:
        """Returns the mean squared error, whose gradient does not reach the latents."""
        rebuilt = self.decode(weights, latents.detach())
        return torch.nn.functional.mse_loss(rebuilt, batch.now)
