"""Contrastive prediction: latents that distinguish a state's future from the futures of others.

Source: InfoNCE (van den Oord, Li and Vinyals, arXiv:1807.03748) with the actions in between, as in
the temporal contrastive learning of Yang and Nachum (arXiv:2102.05815). Latents and actions are
mapped to a query. Its product with the latents of the state `horizon` control steps later must be
larger than its products with the later states of all other rows of the batch.
"""

import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Weights, affine
from jbench.encoders.kinds.predictive import Predictive
from jbench.names import EPISODE_STEPS


class Contrastive(Predictive):
    """Minimizes InfoNCE over pairs of states."""

    epochs: int = Field(default=50, ge=1, description="ours: a row is compared with 512 others")
    batch: int = Field(default=512, ge=2, description="rows in a step; ours")
    horizon: int = Field(default=5, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Returns the layer of the query."""
        return {"query": (latents, self.hidden)}

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the InfoNCE loss (nats) plus the squared error of the reconstruction."""
        latents = self.encode(weights, batch.now)
        queries = affine(weights, "query", self.hidden_units(weights, latents, batch))
        products = queries @ self.encode(weights, batch.later).T
        labels = torch.arange(len(products), device=products.device)
        infonce = torch.nn.functional.cross_entropy(products, labels)
        return infonce + self.reconstruction_error(weights, latents, batch)
