"""Proximal policy optimisation with a clipped objective (Schulman et al., 2017, Algorithm 1)."""

import math
from typing import NamedTuple

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.network import Network, affines, parameter_count
from jbench.agents.batched.tensors import Part, aligned
from jbench.agents.settings import PPOSettings

_LOG_2_PI = math.log(2 * math.pi)
_ADAM_EPSILON = 1e-5  # stable-baselines 2 and 3


class Minibatch(NamedTuple):
    """Some of the transitions of a rollout, each (..., N, 1) but the first.

    Attributes:
        observations: (..., N, dim(O)).
        actions: as they were drawn, not clipped.
        log_likelihoods: of the actions, under the policy that drew them.
        values: of the observations, as they were estimated then.
        advantages: of the actions.
        returns: what the values should have been.
    """

    observations: Tensor
    actions: Tensor
    log_likelihoods: Tensor
    values: Tensor
    advantages: Tensor
    returns: Tensor


class PPO(Learner):
    """PPO, for one seed or for a stack."""

    losses = ("policy_loss", "value_loss", "entropy_loss")

    def __init__(
        self,
        settings: PPOSettings,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
    ) -> None:
        """As for any learner."""
        super().__init__(settings, observation_size, part, low_precision)
        self._settings = settings
        # Both networks and the policy's log sigma are one vector: its gradient is clipped as one.
        self.value_sizes = self.policy_sizes
        parts = [parameter_count(self.policy_sizes), aligned(1), parameter_count(self.value_sizes)]
        self._values = part.keep("policy", sum(parts))
        self._gradient = part.scratch("policy.gradient", sum(parts))
        (actor, log_sigma, critic), (actor_gradient, self._log_sigma_gradient, critic_gradient) = (
            flat.split(parts, dim=-1) for flat in (self._values, self._gradient)
        )
        self.log_sigma = log_sigma[..., :1]
        self.actor, self.critic = (
            Network(part, sizes, values, gradient, tape=tape, low_precision=low_precision)
            for sizes, values, gradient, tape in (
                (self.policy_sizes, actor, actor_gradient, "actor"),
                (self.value_sizes, critic, critic_gradient, "critic"),
            )
        )
        self._adam_of_all = Adam(
            part, "policy", self._values, self._gradient, self._learning_rate, _ADAM_EPSILON
        )

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed: orthogonal matrices, log sigma 0."""
        for network, last_gain in ((self.actor, 0.01), (self.critic, 1.0)):
            layers = affines(network.values, network.sizes)
            for i, (weight, _) in enumerate(layers):
                gain = last_gain if i == len(layers) - 1 else math.sqrt(2)
                drawn = torch.empty(weight.shape, dtype=weight.dtype)
                weight.copy_(torch.nn.init.orthogonal_(drawn, gain, generator=generator))

    def act(self, observations: Tensor) -> Tensor:
        """Returns mu(s), clipped."""
        return self.actor.forward(observations, exact=True).clamp_(-1, 1)

    def policy(self) -> tuple[Network, str]:
        """As `Learner.policy`."""
        return self.actor, "clip"

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns (..., N, 3) drawn actions, their log likelihoods, and V(s).

        Args:
            observations: (..., N, dim(O)).
            noise: (..., N, 1) standard normal numbers.
        """
        log_sigma = self.log_sigma.unsqueeze(-2)
        actions = self.actor.forward(observations, exact=True) + log_sigma.exp() * noise
        log_likelihoods = -0.5 * (noise.square() + _LOG_2_PI) - log_sigma
        return torch.cat([actions, log_likelihoods, self.value(observations)], dim=-1)

    def value(self, observations: Tensor) -> Tensor:
        """Returns V(s), (..., N, 1)."""
        return self.critic.forward(observations, exact=True)

    def update(self, batch: Minibatch) -> None:
        """Learns from a minibatch of N transitions by the gradient of L^CLIP - L^VF + entropy."""
        settings, size = self._settings, batch.actions.shape[-2]
        advantages = batch.advantages
        if settings.normalize_advantage and size > 1:
            spread, mean = torch.std_mean(advantages, dim=-2, keepdim=True)
            advantages = (advantages - mean) / (spread + 1e-8)

        # L^CLIP = 1/N sum min(ratio A, clip(ratio) A), ratio = pi(a | s) / pi_old(a | s)
        log_sigma = self.log_sigma.unsqueeze(-2)
        precision = torch.exp(-2 * log_sigma)
        deviations = batch.actions - self.actor.forward(batch.observations)
        squares = deviations.square() * precision
        ratios = torch.exp(-0.5 * (squares + _LOG_2_PI) - log_sigma - batch.log_likelihoods)
        clipped = ratios.clamp(1 - settings.clip_range, 1 + settings.clip_range)
        surrogates, bounded = advantages * ratios, advantages * clipped
        # Where the clipped term is the lower one, it does not depend on the policy.
        by_log_likelihood = torch.where(surrogates <= bounded, surrogates, 0) / -size
        self.actor.backward(by_log_likelihood * deviations * precision)
        by_log_sigma = (by_log_likelihood * (squares - 1)).sum(dim=-2) - settings.ent_coef
        self._log_sigma_gradient[..., :1].copy_(by_log_sigma)

        # L^VF = 1/N sum (V(s) - return)^2, V clipped to the neighbourhood of what it was
        values = self.critic.forward(batch.observations)
        changes = values - batch.values
        if settings.clip_range_vf is None:
            errors = values - batch.returns
            by_value = errors
        else:
            near = changes.clamp(-settings.clip_range_vf, settings.clip_range_vf)
            errors = batch.values + near - batch.returns
            by_value = torch.where(near == changes, errors, 0)
        self.critic.backward(by_value * (2 * settings.vf_coef / size))

        self._write_down("policy_loss", -torch.minimum(surrogates, bounded))
        self._write_down("value_loss", errors.square())
        self._write_down("entropy_loss", -0.5 * (1 + _LOG_2_PI) - log_sigma)

        # Clip the whole gradient, and take a step.
        norm = torch.linalg.vector_norm(self._gradient, dim=-1, keepdim=True)
        self._gradient.mul_((settings.max_grad_norm / (norm + 1e-6)).clamp_(max=1))
        self._adam_of_all.step()
