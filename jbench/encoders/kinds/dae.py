"""The paper's denoising autoencoder (paper, section 5.2; Vincent et al., 2008).

Its input is corrupted by Gaussian noise, and it learns to reconstruct the clean input.
"""

from typing import Literal

import torch
from array_api_compat import array_namespace
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Weights, standard_normal
from jbench.encoders.kinds.ae import Autoencoder
from jbench.settings.base import omissible
from jbench.tasks.features import TASK_SPECS, Array

_YAW_RATE = 12  # position in every task's observation, after x, y, z, a quaternion and 5 velocities


class DenoisingAutoencoder(Autoencoder):
    """Reconstructs the clean state from a noisy one (paper, equation 1)."""

    noise: float = Field(
        default=0.1, ge=0, description="sd on each scaled feature; paper, section 5.2"
    )

    noise_per: Literal["row", "batch"] = omissible(
        "row", description="whether rows of a minibatch share their noise, as in authors' script"
    )

    def prepare(self, batch: Batch, latents: int, random: torch.Generator) -> Batch:
        """Returns the batch with Gaussian noise on the encoded states."""
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

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns 2 to the number of features plus one."""
        return range(2, TASK_SPECS[task].observation_size + 2)

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns the weights of an autoencoder with one latent less."""
        return super().initial(size, latents - 1, random)

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents of the autoencoder, then the yaw rate."""
        latents = super().encode(weights, scaled)
        return array_namespace(latents).concat(
            [latents, scaled[..., _YAW_RATE : _YAW_RATE + 1]], axis=-1
        )

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the reconstruction of the autoencoder."""
        return super().decode(weights, latents[..., :-1])
