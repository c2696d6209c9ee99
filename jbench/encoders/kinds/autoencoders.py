"""Autoencoders of two layers: plain, denoising, and predicting."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import torch
from pydantic import Field
from torch import Tensor

from jbench.arrays import Array, namespace
from jbench.encoders.kind import Learned
from jbench.encoders.networks import Weights, affine, layers, standard_normal, tanh, tanh_
from jbench.encoders.pairs import StatePairs
from jbench.encoders.states import MAX_HORIZON
from jbench.names import EncoderBase
from jbench.settings.base import omissible
from jbench.tasks.find import find_task

# Where the yaw rate is in every task's observation, after x, y, z, a quaternion and 5 velocities.
_YAW_RATE = slice(12, 13)


class Autoencoder(Learned):
    """A tanh layer encodes, and a tanh layer decodes; minimizes the mean squared error.

    Source: paper, Figure 6, without the noise; Rumelhart, Hinton and Williams (1986).
    """

    initial_weights: Literal["glorot", "normal"] = omissible(
        "glorot",
        description="initial weights: Glorot's or standard normal; authors' script: normal",
    )

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Glorot's initialization, or normal weights, of one layer each way."""
        weights = layers({"encoder": (latents, size), "decoder": (size, latents)}, random)
        if self.initial_weights == "normal":
            for name in ("encoder.weight", "decoder.weight"):
                weights[name].normal_(generator=random)
        return weights

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """One layer and tanh."""
        return tanh(affine(weights, "encoder", scaled))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """One layer and tanh."""
        return tanh(affine(weights, "decoder", latents))

    def loss(self, weights: Weights, batch: StatePairs) -> Tensor:
        """The mean squared error of the reconstruction."""
        rebuilt = self.decode(weights, self.encode(weights, batch.now))
        return torch.nn.functional.mse_loss(rebuilt, batch.later)

    @torch.no_grad()
    def gradient(
        self, weights: Mapping[str, Tensor], gradients: Mapping[str, Tensor], batch: StatePairs
    ) -> Tensor:
        """Computes the gradient by hand, in fewer passes over the rows than autograd.

        For n rows of d features, with z = tanh(W x + b) and y = tanh(V z + c):

            L = 1 / (n d) sum |y - x'|^2      dL / d(V z + c) = 2 (y - x') / (n d) (1 - y^2)
            dL / d(W x + b) = V' dL / d(V z + c) (1 - z^2)
        """
        encoder = weights["encoder.weight"]
        decoder = weights["decoder.weight"]
        latents = tanh_(torch.addmm(weights["encoder.bias"], batch.now, encoder.T))
        rebuilt = tanh_(torch.addmm(weights["decoder.bias"], latents, decoder.T))
        error = rebuilt - batch.later
        loss = error.square().mean()
        # The gradients reuse the memory of `rebuilt` and `latents`.
        delta = _times_slope_(rebuilt, error.mul_(2 / error.numel()))
        torch.mm(delta.T, latents, out=gradients["decoder.weight"])
        torch.sum(delta, 0, out=gradients["decoder.bias"])
        delta = _times_slope_(latents, delta @ decoder)
        torch.mm(delta.T, batch.now, out=gradients["encoder.weight"])
        torch.sum(delta, 0, out=gradients["encoder.bias"])
        return loss


class DenoisingAutoencoder(Autoencoder):
    """Reconstructs the clean state from one with Gaussian noise (paper, section 5.2, equation 1).

    Source: Vincent et al. (2008).
    """

    bases: ClassVar[dict[EncoderBase, dict[str, Any]]] = {
        "script": {"initial_weights": "normal", "noise_per": "batch", "learning_rate": 5e-4}
    }

    noise: float = Field(
        0.1,
        ge=0,
        description="standard deviation of the noise on a scaled feature; paper, section 5.2",
    )
    noise_per: Literal["row", "batch"] = omissible(
        "row", description="whether rows of a minibatch share their noise; authors' script: batch"
    )

    def prepare(self, batch: StatePairs, latents: int, random: torch.Generator) -> StatePairs:
        """Adds noise to what is encoded, not to what is to be reconstructed."""
        rows, size = batch.now.shape
        if self.noise_per == "row":
            noise = standard_normal((rows, size), random, batch.now)
        else:
            noise = standard_normal((-(-rows // self.batch), size), random, batch.now)
            noise = noise.repeat_interleave(self.batch, 0)[:rows]
        return batch._replace(now=noise.mul_(self.noise).add_(batch.now))


class DenoisingAutoencoderWithYawRate(DenoisingAutoencoder):
    """A denoising autoencoder, whose last latent is the scaled yaw rate itself.

    It shows what agents gain that observe the yaw rate in addition to the latents.
    """

    needs_all_features = True

    def latent_sizes(self, task: str, features: int) -> range:
        """One more than the layers have, since the yaw rate is a latent."""
        if not find_task(task).has_planar_reduction:
            return range(0)
        return range(2, features + 2)

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """The weights of an encoder without the yaw rate."""
        return super().initial(size, latents - 1, random)

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Appends the yaw rate as it is observed."""
        latents = super().encode(weights, scaled)
        return namespace(latents).concat([latents, scaled[..., _YAW_RATE]], axis=-1)

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Does without the yaw rate."""
        return super().decode(weights, latents[..., :-1])


class DynamicDenoisingAutoencoder(DenoisingAutoencoder):
    """Predicts the clean state `horizon` control steps later from a noisy one.

    Source: the authors' code, in which it is the denoising autoencoder with another target. Its
    error includes what is unpredictable, such as the effect of the random actions.
    """

    decodes_later = True

    horizon: int = Field(
        default=1, ge=1, lt=MAX_HORIZON, description="control steps ahead that are decoded; ours"
    )


def _times_slope_(tanhs: Tensor, error: Tensor) -> Tensor:
    """Returns error * (1 - tanhs ** 2), written to the memory of `tanhs`."""
    return tanhs.square_().neg_().add_(1).mul_(error)
