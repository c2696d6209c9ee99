"""Contrastive prediction: latents that distinguish a state's future from the futures of others.

Source: InfoNCE (van den Oord, Li and Vinyals, arXiv:1807.03748) with the actions in between, as in
the temporal contrastive learning of Yang and Nachum (arXiv:2102.05815). The encoder is one tanh
layer, as in the denoising autoencoder. A hidden tanh layer maps the latents of a state and the
actions to a query. The query's product with the latents of the state `horizon` control steps later
must be larger than its products with the later states of all other rows of the batch.
"""

from typing import ClassVar

import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Learned, Weights, tanh
from jbench.encoders.kinds.vae import affine, layers
from jbench.names import EPISODE_STEPS
from jbench.tasks.features import Array


class Contrastive(Learned):
    """Minimises InfoNCE over pairs of states."""

    uses_actions: ClassVar[bool] = True

    epochs: int = Field(default=50, ge=1, description="ours: a row is compared with 512 others")
    batch: int = Field(default=512, ge=2, description="rows in a step; ours")
    hidden: int = Field(default=64, ge=1, description="units of the predictor; ours")
    horizon: int = Field(default=5, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    @property
    def steps_ahead(self) -> int:
        """Control steps to the later state."""
        return self.horizon

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns Glorot weights and zero biases."""
        return layers(
            {
                "encoder": (latents, size),
                "hidden": (self.hidden, latents + self.horizon),
                "query": (latents, self.hidden),
                "decoder": (size, latents),
            },
            random,
        )

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents, in (-1, 1)."""
        return tanh(affine(weights, "encoder", scaled))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the linear reconstruction, trained without influence on the latents."""
        return affine(weights, "decoder", latents)

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the InfoNCE loss (nats) plus the squared error of the reconstruction."""
        assert batch.actions is not None
        latents = self.encode(weights, batch.now)
        hidden = tanh(affine(weights, "hidden", torch.cat([latents, batch.actions], 1)))
        products = affine(weights, "query", hidden) @ self.encode(weights, batch.later).T
        labels = torch.arange(len(products), device=products.device)
        rebuilt = self.decode(weights, latents.detach())
        return torch.nn.functional.cross_entropy(products, labels) + torch.nn.functional.mse_loss(
            rebuilt, batch.now
        )
