"""A variational autoencoder with locally linear latent dynamics (Watter et al., arXiv:1506.07365).

"Embed to Control": the latent of the next state is A z + B u + o for the action u, where the matrix
A = I + v r', the vector B and the offset o depend on z. The next state must be likely under the
predicted latent, whose distribution must be close to that of the next state's own latent.
"""

from typing import ClassVar, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from jbench.encoders.batch import Batch
from jbench.encoders.kind import Weights, affine, layers, tanh
from jbench.encoders.kinds.vae import (
    VariationalAutoencoder,
    kl_to_standard_normal,
    sample_latents,
)
from jbench.simulation import find_task

_EPSILON = 1e-6  # keeps the logarithm of det(A) ** 2 finite


class Transition(NamedTuple):
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
    """Maximizes the evidence lower bound of pairs of states with the action in between."""

    uses_actions: ClassVar[bool] = True

    contraction: float = Field(
        default=0.1, ge=0, description="weight of the divergence of the predicted latent; authors'"
    )

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns 1 to the features of a task with a single actuator; its dynamics have one."""
        return super().latent_sizes(task) if find_task(task).action_size == 1 else range(0)

    @property
    def steps_ahead(self) -> int:
        """One control step, that of the action."""
        return 1

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns Glorot weights and zero biases."""
        dynamics = {"dynamics": (self.hidden, latents), "transition": (4 * latents, self.hidden)}
        return super().initial(size, latents, random) | layers(dynamics, random)

    def transition(self, weights: Weights, latents: Tensor) -> Transition:
        """Returns the dynamics linearized at latents (rows, latents)."""
        hidden = tanh(affine(weights, "dynamics", latents))
        return Transition(*affine(weights, "transition", hidden).chunk(4, dim=1))

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns equation 12 of the paper without constants, in nats per pair of states."""
        assert batch.actions is not None
        mean, log_variance = self.posterior(weights, batch.now)
        latents = sample_latents(mean, log_variance, batch)
        dynamics = self.transition(weights, latents)
        predicted = dynamics(latents, batch.actions)
        bound = self.reconstruction_nll(weights, latents, batch.now)
        bound = bound + self.reconstruction_nll(weights, predicted, batch.later)
        bound = bound + kl_to_standard_normal(mean, log_variance)
        contraction = divergence(
            dynamics,
            dynamics(mean, batch.actions),
            log_variance,
            *self.posterior(weights, batch.later),
        )
        return (bound + self.contraction * contraction).mean()


def divergence(
    dynamics: Transition,
    predicted: Tensor,
    log_variance: Tensor,
    mean: Tensor,
    later_log_variance: Tensor,
) -> Tensor:
    """Returns the (rows,) KL divergence of the predicted latent from the next state's (nats).

    Args:
        dynamics: from the state to the next one.
        predicted: (rows, latents) mean of the predicted latent, whose covariance is A S A'.
        log_variance: (rows, latents) log diagonal of S, the covariance of the state's latent.
        mean: (rows, latents) mean of the next state's latent.
        later_log_variance: (rows, latents) log variance of the next state's latent.
    """
    v, r, variance = dynamics.v, dynamics.r, log_variance.exp()
    around = (r.square() * variance).sum(1, keepdim=True)
    diagonal = variance * (1 + 2 * v * r) + v.square() * around
    log_determinant = ((1 + (v * r).sum(1)).square() + _EPSILON).log() + log_variance.sum(1)
    spread = (diagonal + (predicted - mean).square()) * (-later_log_variance).exp() - 1
    return (spread.sum(1) + later_log_variance.sum(1) - log_determinant) / 2
