"""Variational autoencoders, without and with dynamics of the latents."""

from typing import NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from jbench.arrays import Array
from jbench.encoders.kind import Learned
from jbench.encoders.networks import Weights, affine, layers, standard_normal, tanh
from jbench.encoders.pairs import StatePairs
from jbench.tasks.find import find_task


class VariationalAutoencoder(Learned):
    """Maximizes the evidence lower bound of the states (Kingma and Welling, arXiv:1312.6114).

    Encoder and decoder have one hidden tanh layer each. A state's latent is Gaussian with diagonal
    covariance, whose mean is the encoder's output, and a state is Gaussian around the decoded one.
    """

    hidden: int = Field(default=64, ge=1, description="units in each hidden layer; ours")
    observation_sd: float = Field(
        default=0.1,
        gt=0,
        description="standard deviation of a decoded feature; ours, as dae's noise",
    )

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Glorot's initialization of the Gaussian and of the way back."""
        units = self.hidden
        gaussian = {"mean": (latents, units), "log_variance": (latents, units)}
        back = {"back": (units, latents), "state": (size, units)}
        return layers({"hidden": (units, size), **gaussian, **back}, random)

    def prepare(self, batch: StatePairs, latents: int, random: torch.Generator) -> StatePairs:
        """Draws the noise of the latents."""
        return batch._replace(noise=standard_normal((len(batch.now), latents), random, batch.now))

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """The mean of the Gaussian."""
        return affine(weights, "mean", tanh(affine(weights, "hidden", scaled)))

    def decode(self, weights: Weights, latents: Array) -> Array:
        """The mean of the states that a latent stands for."""
        return affine(weights, "state", tanh(affine(weights, "back", latents)))

    def loss(self, weights: Weights, batch: StatePairs) -> Tensor:
        """Returns the negative bound without constants, in nats per state (equation 10)."""
        mean, log_variance = self.posterior(weights, batch.now)
        latents = mean + (log_variance / 2).exp() * batch.noise  # a sample (section 2.4)
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


class LocalDynamics(NamedTuple):
    """Locally linear dynamics, each (rows, latents): A = I + v r', B and o."""

    v: Tensor
    r: Tensor
    B: Tensor
    o: Tensor

    def __call__(self, latents: Tensor, actions: Tensor) -> Tensor:
        """Returns the latents (rows, latents) one step later for actions (rows, 1)."""
        along = (self.r * latents).sum(1, keepdim=True)
        return latents + self.v * along + self.B * actions + self.o


class LocallyLinearVariationalAutoencoder(VariationalAutoencoder):
    """Maximizes the evidence lower bound of pairs of states with the action in between.

    "Embed to Control" (Watter et al., arXiv:1506.07365): the latent of the next state is
    A z + B u + o for the action u, where the matrix A = I + v r', the vector B and the offset o
    depend on z. The next state must be likely under the predicted latent, whose distribution must
    be close to that of the next state's own latent.
    """

    uses_actions = True

    contraction: float = Field(
        default=0.1,
        ge=0,
        description="weight of the divergence of the predicted latents; authors' code",
    )

    def latent_sizes(self, task: str, features: int) -> range:
        """Returns 1 to the features of a task with a single actuator; its dynamics have one."""
        if find_task(task).action_size > 1:
            return range(0)
        return super().latent_sizes(task, features)

    @property
    def steps_ahead(self) -> int:
        """The next state."""
        return 1

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Adds a network for the locally linear dynamics."""
        dynamics = {"dynamics": (self.hidden, latents), "transition": (4 * latents, self.hidden)}
        return super().initial(size, latents, random) | layers(dynamics, random)

    def transition(self, weights: Weights, latents: Tensor) -> LocalDynamics:
        """Returns the dynamics linearized at latents (rows, latents)."""
        hidden = tanh(affine(weights, "dynamics", latents))
        return LocalDynamics(*affine(weights, "transition", hidden).chunk(4, dim=1))

    def loss(self, weights: Weights, batch: StatePairs) -> Tensor:
        """Returns equation 12 of the paper without constants, in nats per pair of states."""
        mean, log_variance = self.posterior(weights, batch.now)
        latents = mean + (log_variance / 2).exp() * batch.noise  # a sample (section 2.4)
        dynamics = self.transition(weights, latents)
        predicted = dynamics(latents, batch.actions)
        bound = self.reconstruction_nll(weights, latents, batch.now)
        bound = bound + self.reconstruction_nll(weights, predicted, batch.later)
        bound = bound + kl_to_standard_normal(mean, log_variance)
        drift = dynamics(mean, batch.actions)
        later = self.posterior(weights, batch.later)
        contraction = divergence(dynamics, drift, log_variance, *later)
        return (bound + self.contraction * contraction).mean()


def kl_to_standard_normal(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Returns the (rows,) KL divergence of a diagonal Gaussian from the standard one (nats)."""
    return (mean.square() + log_variance.exp() - 1 - log_variance).sum(1) / 2


def divergence(
    dynamics: LocalDynamics,
    predicted: Tensor,
    log_variance: Tensor,
    mean: Tensor,
    later_log_variance: Tensor,
) -> Tensor:
    """Returns the (rows,) KL divergence of the predicted latent from the next state's (nats).

    The predicted latent has the mean `predicted` and the covariance A S A', and S, the covariance
    of the state's latent, has the log diagonal `log_variance`. `mean` and `later_log_variance` are
    those of the next state's latent. All are (rows, latents).
    """
    v = dynamics.v
    r = dynamics.r
    variance = log_variance.exp()
    around = (r.square() * variance).sum(1, keepdim=True)
    diagonal = variance * (1 + 2 * v * r) + v.square() * around
    log_determinant = ((1 + (v * r).sum(1)).square() + 1e-6).log() + log_variance.sum(1)
    spread = (diagonal + (predicted - mean).square()) * (-later_log_variance).exp() - 1
    return (spread.sum(1) + later_log_variance.sum(1) - log_determinant) / 2
