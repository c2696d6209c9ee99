"""An inverse model: latents of two states from which the actions between them can be predicted.

Source: the inverse dynamics of Agrawal et al. (arXiv:1606.07419) and Pathak et al.
(arXiv:1705.05363), which keep what the agent controls. It is trained on states and actions alone.
"""

import torch
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Weights, affine, tanh
from jbench.encoders.kinds.predictive import Predictive


class InverseModel(Predictive):
    """Predicts the actions of `horizon` control steps from the latents before and after them."""

    def hidden_inputs(self, latents: int, actions: int) -> int:
        """Returns the size of two states' latents."""
        return 2 * latents

    def heads(self, size: int, latents: int, actions: int) -> dict[str, tuple[int, int]]:
        """Returns the layer that predicts the actions."""
        return {"action": (actions, self.hidden)}

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the sum of the mean squared errors of the actions and the reconstruction."""
        assert batch.actions is not None
        latents = self.encode(weights, batch.now)
        pair = torch.cat([latents, self.encode(weights, batch.later)], 1)
        actions = affine(weights, "action", tanh(affine(weights, "hidden", pair)))
        return torch.nn.functional.mse_loss(actions, batch.actions) + self.reconstruction_error(
            weights, latents, batch
        )
