"""Soft actor-critic with a learned temperature (Haarnoja et al., 2018b, Algorithm 1)."""

import math
from typing import NamedTuple

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.learner import OffPolicyLearner, sum_over_actions
from jbench.agents.batched.network import Layout
from jbench.agents.batched.replay import Batch
from jbench.settings.algorithms import SACSettings

# Bounds of log sigma(s), as in the authors' code.
_MIN_LOG_SIGMA = -20
_MAX_LOG_SIGMA = 2
# Keeps the logarithm of tanh's derivative finite at actions of 1 and -1, as in the authors' code.
_EPSILON = 1e-6
_HALF_LOG_2_PI = 0.5 * math.log(2 * math.pi)


class _Sampled(NamedTuple):
    """Actions a = tanh(u) that a policy has sampled, u = mu + sigma e for noise e.

    Attributes:
        actions: (..., N, action_size).
        log_likelihoods: (..., N, 1) log pi(a | s).
        scaled_noise: (..., N, action_size) sigma(s) e.
        in_bounds: (..., N, action_size) whether log sigma(s) is within its bounds.
    """

    actions: Tensor
    log_likelihoods: Tensor
    scaled_noise: Tensor
    in_bounds: Tensor


class SACLearner(OffPolicyLearner[SACSettings]):
    """SAC, for one seed or for a stack."""

    losses = ("actor_loss", "critic_loss", "entropy_coefficient")
    is_stochastic = True

    def _make_networks(self) -> None:
        """Makes the networks, and the temperature with its optimizer."""
        settings = self.settings
        view = self.view
        action_size = self.action_size
        self.noise_per_transition = 2 * action_size
        self._target_entropy = -float(action_size)
        if settings.target_entropy != "auto":
            self._target_entropy = settings.target_entropy
        # The actor's outputs are mu(s) and log sigma(s).
        layout = Layout((*self.policy_layout.sizes[:-1], 2 * action_size))
        self.actor = self._network("actor", layout, workspace="actor")
        # Both critics' activations are needed at the same time, those of their targets are not.
        self.critics = self._critics(["critic1", "critic2"], ["critic1", "critic2"])
        self.critic_targets = self._critics(
            ["critic1_target", "critic2_target"], ["critic1", "critic1"]
        )
        self.log_temperature = view.state("log_temperature", 1)
        self._temperature_gradient = view.scratch("log_temperature.gradient", 1)
        if settings.ent_coef == "auto":
            self._temperature_adam = Adam(
                view,
                "log_temperature",
                self.log_temperature,
                self._temperature_gradient,
                settings.learning_rate,
            )

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        super().initialize(generator)
        initial = 1.0 if self.settings.ent_coef == "auto" else self.settings.ent_coef
        self.log_temperature.fill_(initial).log_()

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns actions sampled from pi(. | s)."""
        return self._sample(observations, noise, exact=True).actions

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether the target networks are updated."""
        return update_of_call % self.settings.target_update_interval == 0

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Makes one update from a minibatch of N transitions (s, a, r, s').

        With a' ~ pi(. | s') and y = r + gamma (min Q'_i(s', a') - alpha log pi(a' | s')) constant,
        and a = tanh(u) ~ pi(. | s), u = mu + sigma e, reparametrized, so that
        log pi(a | s) = -e^2 / 2 - log sigma - log(1 - a^2) + constant:

            L_Q  = sum_i 1/2N sum (Q_i(s, a) - y)^2            dL_Q / dQ_i = (Q_i(s, a) - y) / N
            L_pi = 1/N sum (alpha log pi(a | s) - min Q_i(s, a))
            dL_pi / da = -1/N dmin Q / da + alpha / N 2 a / (1 - a^2)
            dL_pi / dmu = dL_pi / du = dL_pi / da (1 - a^2)
            dL_pi / dlog sigma = dL_pi / du sigma e - alpha / N    (0 outside log sigma's bounds)
            L_alpha = -1/N sum log alpha (log pi(a | s) + target entropy)
        """
        temperature = self.log_temperature.exp().unsqueeze(-1)

        noise, next_noise = batch.noise.split(self.action_size, dim=-1)
        following = self._sample(batch.next_observations, next_noise)
        # The next actions are columns of `next_state_actions`, and the actions of `state_actions`.
        batch.next_actions.copy_(following.actions)
        both = (critic.forward(batch.next_state_actions) for critic in self.critic_targets)
        next_values = torch.minimum(*both)
        next_values.addcmul_(temperature, following.log_likelihoods, value=-1)
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Minimize L_Q over the critics.
        squared_errors = self._fit_critics(batch.state_actions, targets, scale=1)
        self._record_loss("critic_loss", squared_errors.mul_(0.5))

        # Minimize L_pi over the actor.
        sampled = self._sample(batch.observations, noise)
        actions = sampled.actions
        batch.actions.copy_(actions)
        first, second = (critic.forward(batch.state_actions) for critic in self.critics)
        losses = temperature * sampled.log_likelihoods - torch.minimum(first, second)
        self._record_loss("actor_loss", losses)
        by_action = self._minimum_gradient(first, second, -batch.mean_weight)
        weight = temperature * batch.mean_weight
        by_action = by_action + weight * 2 * actions / (1 + _EPSILON - actions.square())
        by_mu = torch.ops.aten.tanh_backward(by_action, actions)
        by_log_sigma = (by_mu * sampled.scaled_noise - weight) * sampled.in_bounds
        self.actor.backward(torch.cat([by_mu, by_log_sigma], dim=-1))
        self.actor.step()

        # Minimize L_alpha over log alpha.
        self._record_loss("entropy_coefficient", temperature)
        if self.settings.ent_coef == "auto":
            torch.mean(sampled.log_likelihoods, dim=-2, out=self._temperature_gradient)
            self._temperature_gradient.add_(self._target_entropy).neg_()
            self._temperature_adam.step()

        if delayed:
            self._update_targets(self.settings.tau)

    def _sample(self, observations: Tensor, noise: Tensor, *, exact: bool = False) -> _Sampled:
        """Samples actions with standard normal noise (..., N, action_size)."""
        outputs = self.actor.forward(observations, exact=exact)
        mean, raw = outputs.split(self.action_size, dim=-1)
        log_sigma = raw.clamp(_MIN_LOG_SIGMA, _MAX_LOG_SIGMA)
        scaled_noise = log_sigma.exp() * noise
        actions = torch.tanh(mean + scaled_noise)
        # log pi(a | s) = log N(u; mu, sigma) - log da/du
        log_slope = torch.log(1 + _EPSILON - actions.square())
        log_likelihoods = -0.5 * noise.square() - log_sigma - _HALF_LOG_2_PI - log_slope
        return _Sampled(actions, sum_over_actions(log_likelihoods), scaled_noise, raw == log_sigma)

    def _minimum_gradient(self, first: Tensor, second: Tensor, by_minimum: Tensor) -> Tensor:
        """Returns the gradient by the actions, given that by the lower value (..., N, 1)."""
        is_first = first <= second
        if self.view.is_stack:
            by_first = is_first.to(by_minimum.dtype).mul_(by_minimum)
            deltas = by_first, by_minimum - by_first
            pairs = zip(self.critics, deltas, strict=True)
            gradient, other = (critic.action_gradient(delta) for critic, delta in pairs)
            return gradient.add_(other)
        # Each critic goes backward on its own rows only. This halves the work, but the sizes vary,
        # which a CUDA graph does not allow.
        by_action = by_minimum.new_empty(len(by_minimum), self.action_size)
        for critic, mask in zip(self.critics, (is_first, ~is_first), strict=True):
            rows = mask.view(-1).nonzero().view(-1)
            gradient = critic.action_gradient(by_minimum.index_select(0, rows), rows)
            by_action.index_copy_(0, rows, gradient)
        return by_action
