"""The variational autoencoder (Kingma and Welling, arXiv:1312.6114); the mean is the latent.

Encoder and decoder have one hidden tanh layer each. A state's latent is Gaussian with diagonal
covariance, and a state is Gaussian around the decoded latent.
"""

import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Learned, Weights, affine, layers, standard_normal, tanh
from jbench.tasks.features import Array


class VariationalAutoencoder(Learned):
    """Maximizes the evidence lower bound of the states."""

    hidden: int = Field(default=64, ge=1, description="units in each hidden layer; ours")
    observation_sd: float = Field(
        default=0.1, gt=0, description="of a scaled feature given its latent; ours, as dae's noise"
    )

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns Glorot weights and zero biases."""
        return layers(
            {
                "hidden": (self.hidden, size),
                "mean": (latents, self.hidden),
                "log_variance": (latents, self.hidden),
                "back": (self.hidden, latents),
                "state": (size, self.hidden),
            },
            random,
        )

    def prepare(self, batch: Batch, latents: int, random: torch.Generator) -> Batch:
        """Returns the batch with standard normal noise for the latents."""
        return batch._replace(noise=standard_normal((len(batch.now), latents), random, batch.now))

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the means."""
        return affine(weights, "mean", tanh(affine(weights, "hidden", scaled)))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the expected states."""
        return affine(weights, "state", tanh(affine(weights, "back", latents)))

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns the negative bound without constants, in nats per state (equation 10)."""
        mean, log_variance = self.posterior(weights, batch.now)
        latents = sample_latents(mean, log_variance, batch)
        nll = self.reconstruction_nll(weights, latents, batch.now)
        return (nll + kl_to_standard_normal(mean, log_variance)).mean()

    def posterior(self, weights: Weights, scaled: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and log variance (rows, latents) of the latents of states."""
        hidden = tanh(affine(weights, "hidden", scaled))
        return affine(weights, "mean", hidden), affine(weights, "log_variance", hidden)

    def reconstruction_nll(self, weights: Weights, latents: Tensor, states: Tensor) -> Tensor:
        """Returns the (rows,) negative log likelihood of states, without the constant (nats)."""
        errors: Tensor = self.decode(weights, latents) - states
        return (errors / self.observation_sd).square().sum(1) / 2


def sample_latents(mean: Tensor, log_variance: Tensor, batch: Batch) -> Tensor:
    """Samples latents with the noise of a prepared batch (section 2.4)."""
    assert batch.noise is not None
    return mean + (log_variance / 2).exp() * batch.noise


def kl_to_standard_normal(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Returns the (rows,) KL divergence of a diagonal Gaussian from the standard one (nats)."""
    return (mean.square() + log_variance.exp() - 1 - log_variance).sum(1) / 2
