"""The paper's denoising autoencoder (paper, section 5.2; Vincent et al., 2008).

Its input is corrupted by Gaussian noise, and it learns to reconstruct the clean input.
"""

import torch
from pydantic import Field

from jbench.encoders.batch import Batch
from jbench.encoders.kind import standard_normal
from jbench.encoders.kinds.ae import Autoencoder


class DenoisingAutoencoder(Autoencoder):
    """Reconstructs the clean state from a noisy one (paper, equation 1)."""

    noise: float = Field(
        default=0.1, ge=0, description="sd on each scaled feature; paper, section 5.2"
    )

    def prepare(self, batch: Batch, latents: int, random: torch.Generator) -> Batch:
        """Returns the batch with Gaussian noise on the encoded states."""
        noise = standard_normal(batch.now.shape, random, batch.now)
        return batch._replace(now=noise.mul_(self.noise).add_(batch.now))
