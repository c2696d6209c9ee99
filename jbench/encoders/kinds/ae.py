"""The plain autoencoder: one tanh layer to the latent, one tanh layer back.

Source: paper, Figure 6, without the noise; Rumelhart, Hinton and Williams (1986). The layers are
the denoising autoencoder's (`dae.py`), which is an option of these few lines.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from jbench.encoders.kind import Batch, Learned, Weights, glorot, tanh, tanh_
from jbench.tasks.features import Array


class Autoencoder(Learned):
    """Reconstructs what it sees through fewer numbers, by the mean squared error."""

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns Glorot's weights, and biases of 0."""
        return {
            "encoder.weight": glorot(latents, size, random),
            "encoder.bias": torch.zeros(latents),
            "decoder.weight": glorot(size, latents, random),
            "decoder.bias": torch.zeros(size),
        }

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents, in (-1, 1)."""
        return tanh(scaled @ weights["encoder.weight"].T + weights["encoder.bias"])

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the reconstruction, in (-1, 1)."""
        return tanh(latents @ weights["decoder.weight"].T + weights["decoder.bias"])

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the mean squared error of a feature."""
        rebuilt = self.decode(weights, self.encode(weights, batch.now))
        return torch.nn.functional.mse_loss(rebuilt, batch.later)

    @torch.no_grad()
    def gradient(
        self, weights: Mapping[str, Tensor], gradients: Mapping[str, Tensor], batch: Batch
    ) -> Tensor:
        """Does by hand what autograd does, in fewer passes over the rows."""
        into, back = weights["encoder.weight"], weights["decoder.weight"]
        latents = tanh_(torch.addmm(weights["encoder.bias"], batch.now, into.T))
        rebuilt = tanh_(torch.addmm(weights["decoder.bias"], latents, back.T))
        error = rebuilt - batch.later
        loss = error.square().mean()
        # From here on `rebuilt` and `latents` become the errors that come back through them.
        through = _times_slope_(rebuilt, error.mul_(2 / error.numel()))
        torch.mm(through.T, latents, out=gradients["decoder.weight"])
        torch.sum(through, 0, out=gradients["decoder.bias"])
        through = _times_slope_(latents, through @ back)
        torch.mm(through.T, batch.now, out=gradients["encoder.weight"])
        torch.sum(through, 0, out=gradients["encoder.bias"])
        return loss


def _times_slope_(tanhs: Tensor, error: Tensor) -> Tensor:
    """Returns error * (1 - tanhs ** 2), the error before a tanh, in the memory of `tanhs`."""
    return tanhs.square_().neg_().add_(1).mul_(error)
