"""Soft actor-critic with a learned temperature (Haarnoja et al., 2018b, Algorithm 1)."""

import math
from typing import ClassVar, NamedTuple

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.learner import (
    OffPolicyLearner,
    initialize_uniform,
    polyak_update,
    tanh_gradient,
)
from jbench.agents.batched.network import Network
from jbench.agents.batched.tensors import Part
from jbench.settings.algorithms import SACSettings

# Bounds of the logarithm of the policy's standard deviation, as in the authors' code.
_LOWEST, _HIGHEST = -20, 2
# Keeps the logarithm of tanh's derivative finite where an action is 1, as in the authors' code.
_EPSILON = 1e-6
_HALF_LOG_2_PI = 0.5 * math.log(2 * math.pi)


class Sample(NamedTuple):
    """Actions a = tanh(u), u = mu(s) + sigma(s) e, that a policy drew; each (..., N, 1).

    Attributes:
        actions: a.
        log_likelihoods: log pi(a | s).
        spread: sigma(s) e, which is u's derivative by log sigma(s).
        free: 1 where log sigma(s) lies within its bounds, else 0.
    """

    actions: Tensor
    log_likelihoods: Tensor
    spread: Tensor
    free: Tensor


class SAC(OffPolicyLearner):
    """SAC, for one seed or for a stack."""

    losses: ClassVar[tuple[str, ...]] = ("actor_loss", "critic_loss", "entropy_coefficient")
    noise_per_transition = 2
    random_policy = True

    def __init__(
        self,
        settings: SACSettings,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
    ) -> None:
        """As for any learner."""
        super().__init__(settings, observation_size, part, low_precision)
        self._tau, self._interval = settings.tau, settings.target_update_interval
        self._target_entropy = -1.0
        if settings.target_entropy != "auto":
            self._target_entropy = settings.target_entropy
        self._learns_temperature = settings.ent_coef == "auto"
        self._first_temperature = 1.0 if settings.ent_coef == "auto" else settings.ent_coef
        # The policy's outputs are mu(s) and log sigma(s).
        sizes = (*self.policy_sizes[:-1], 2)
        self.actor = self._network("actor", sizes, workspace="actor")
        # Each critic needs its activations until both are known, their targets no longer.
        self.critics = self._critics(["critic1", "critic2"], ["critic1", "critic2"])
        self.critic_targets = self._critics(
            ["critic1_target", "critic2_target"], ["critic1", "critic1"], False
        )
        self._actor_adam = self._adam("actor", self.actor)
        self._critic_adams = [
            self._adam(f"critic{i}", critic) for i, critic in enumerate(self.critics, 1)
        ]
        self.log_temperature = part.keep("log_temperature", 1)
        self._temperature_gradient = part.scratch("log_temperature.gradient", 1)
        if self._learns_temperature:
            self._temperature_adam = Adam(
                part,
                "log_temperature",
                self.log_temperature,
                self._temperature_gradient,
                self._learning_rate,
            )

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed."""
        for network in (self.actor, *self.critics):
            initialize_uniform(network.layers, generator)
        for target, critic in zip(self.critic_targets, self.critics, strict=True):
            target.values.copy_(critic.values)
        self.log_temperature.fill_(self._first_temperature).log_()

    def act(self, observations: Tensor) -> Tensor:
        """Returns tanh(mu(s))."""
        return self.actor.forward(observations, exact=True)[..., :1].tanh()

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns actions drawn from pi(. | s)."""
        return self._sample(observations, noise, exact=True).actions

    def policy(self) -> tuple[Network, str]:
        """As `Learner.policy`."""
        return self.actor, "tanh"

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether the target networks are updated."""
        return update_of_call % self._interval == 0

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Learns from a minibatch of N transitions (s, a, r, s')."""
        temperature = self.log_temperature.exp().unsqueeze(-1)

        # y = r + gamma (min Q'(s', a') - alpha log pi(a' | s')) with a' ~ pi(. | s')
        following = self._sample(batch.next_observations, batch.noise[..., 1:])
        batch.next_actions.copy_(following.actions)
        next_values = torch.minimum(
            *(q.forward(batch.next_state_actions) for q in self.critic_targets)
        )
        next_values.addcmul_(temperature, following.log_likelihoods, value=-1)
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Update the critics by minimising 1/N sum (y - Q(s, a))^2 / 2 for each of them.
        losses = torch.zeros_like(targets)
        for critic, adam in zip(self.critics, self._critic_adams, strict=True):
            errors = critic.forward(batch.state_actions) - targets
            critic.backward(errors * batch.share)
            adam.step()
            losses.addcmul_(errors, errors, value=0.5)
        self._record_loss("critic_loss", losses)

        # Update the policy by minimising 1/N sum (alpha log pi(a | s) - min Q(s, a)), a ~ pi(s).
        drawn = self._sample(batch.observations, batch.noise[..., :1])
        batch.actions.copy_(drawn.actions)
        first, second = (critic.forward(batch.state_actions) for critic in self.critics)
        self._record_loss(
            "actor_loss", temperature * drawn.log_likelihoods - torch.minimum(first, second)
        )
        descent = self._lower_gradient(first, second, -batch.share)
        self.actor.backward(self._policy_gradient(drawn, temperature, descent, batch.share))
        self._actor_adam.step()

        # Update the temperature by minimising -1/N sum log alpha (log pi(a | s) + target entropy).
        self._record_loss("entropy_coefficient", temperature)
        if self._learns_temperature:
            torch.mean(drawn.log_likelihoods, dim=-2, out=self._temperature_gradient)
            self._temperature_gradient.add_(self._target_entropy).neg_()
            self._temperature_adam.step()

        # Update the target networks.
        if delayed:
            for target, critic in zip(self.critic_targets, self.critics, strict=True):
                polyak_update(target, critic, self._tau)

    def _sample(self, observations: Tensor, noise: Tensor, exact: bool = False) -> Sample:
        """Returns an action for each observation, drawn with noise e (..., N, 1)."""
        outputs = self.actor.forward(observations, exact=exact)
        raw = outputs[..., 1:]
        log_sigma = raw.clamp(_LOWEST, _HIGHEST)
        spread = log_sigma.exp() * noise
        actions = torch.tanh(outputs[..., :1] + spread)
        # The likelihood of u, by the derivative of tanh.
        squashing = torch.log(1 + _EPSILON - actions.square())
        log_likelihoods = -0.5 * noise.square() - log_sigma - _HALF_LOG_2_PI - squashing
        return Sample(actions, log_likelihoods, spread, raw == log_sigma)

    def _lower_gradient(self, first: Tensor, second: Tensor, by_lower: Tensor) -> Tensor:
        """Returns the gradient of a loss by the actions that both critics have just valued.

        Args:
            first: value (..., N, 1) by the first critic.
            second: value by the second.
            by_lower: the loss's gradient by the lower of the two.
        """
        ours = first <= second
        if self.part.lead:
            weight = ours.to(by_lower.dtype).mul_(by_lower)
            descent = self.critics[0].action_gradient(weight)
            return descent.add_(self.critics[1].action_gradient(by_lower - weight))
        # Each critic has its own rows: half of the products, but of sizes that are not known
        # before, as a GPU would want them.
        descent = torch.empty_like(by_lower)
        for critic, mask in zip(self.critics, (ours, ~ours), strict=True):
            rows = mask.view(-1).nonzero().view(-1)
            gradient = critic.action_gradient(by_lower.index_select(0, rows), rows)
            descent.index_copy_(0, rows, gradient)
        return descent

    def _policy_gradient(
        self, drawn: Sample, temperature: Tensor, descent: Tensor, share: Tensor
    ) -> Tensor:
        """Returns the gradient (..., N, 2) of the policy's loss by mu(s) and log sigma(s).

        Args:
            drawn: the actions.
            temperature: alpha.
            descent: gradient of the part of the loss that the critics give, by the actions.
            share: 1 / N.
        """
        weight = temperature * share
        actions = drawn.actions
        by_actions = descent + weight * 2 * actions / (1 + _EPSILON - actions.square())
        by_mu = tanh_gradient(by_actions, actions)
        by_log_sigma = (by_mu * drawn.spread - weight) * drawn.free
        return torch.cat([by_mu, by_log_sigma], dim=-1)
