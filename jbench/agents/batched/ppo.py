"""Proximal policy optimization with a clipped objective (Schulman et al., 2017, Algorithm 1)."""

import math

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.learner import Learner, sum_over_actions
from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.tensors import aligned
from jbench.settings.algorithms import PPOSettings

_LOG_2_PI = math.log(2 * math.pi)
_ADAM_EPSILON = 1e-5  # stable-baselines 2 and 3


class Transitions:
    """Transitions of a rollout, or a minibatch of them, as views of the columns of `rows`.

    Attributes:
        rows: (..., N, width).
        observations: (..., N, dim(O)).
        explored: (..., N, action_size + 2) what `PPOLearner.explore` returned for them, of which
            three attributes are views:
        actions: (..., N, action_size), not clipped.
        log_likelihoods: (..., N, 1) of the actions under the policy that collected the rollout.
        values: (..., N, 1) estimates of V(s) at the time of the rollout.
        advantages: (..., N, 1) of the actions.
        returns: (..., N, 1) targets of V(s).
        rewards: (..., N, 1).
    """

    def __init__(self, rows: Tensor, action_size: int) -> None:
        size = rows.shape[-1] - self.width(0, action_size)
        self.rows = rows
        self.observations, self.explored, self.advantages, self.returns, self.rewards = rows.split(
            [size, action_size + 2, 1, 1, 1], dim=-1
        )
        self.actions, self.log_likelihoods, self.values = self.explored.split(
            [action_size, 1, 1], dim=-1
        )

    @staticmethod
    def width(observation_size: int, action_size: int) -> int:
        """Returns the number of columns of a row."""
        return observation_size + action_size + 5


class PPOLearner(Learner[PPOSettings]):
    """PPO, for one seed or for a stack."""

    losses = ("policy_loss", "value_loss", "entropy_loss")
    squash = "clip"

    def _make_networks(self) -> None:
        """Makes the networks and log sigma as parts of one vector."""
        view = self.view
        is_shared = self.settings.shared_layers
        hidden = self.policy_layout.sizes[:-1]
        # One network with the outputs mu(s) and V(s), or two networks.
        actor_outputs = self.action_size
        if is_shared:
            actor_outputs += 1
        actor_layout = Layout((*hidden, actor_outputs))
        critic_layout = Layout((*hidden, 1))

        # Networks and log sigma are one vector, because their gradient is clipped by its norm.
        lengths = [actor_layout.length, aligned(self.action_size)]
        if not is_shared:
            lengths.append(critic_layout.length)
        self._values = view.state("policy", sum(lengths))
        self._gradient = view.scratch("policy.gradient", sum(lengths))
        values = self._values.split(lengths, dim=-1)
        gradients = self._gradient.split(lengths, dim=-1)

        self.actor = Network(view, actor_layout, values[0], gradients[0], workspace="actor")
        self.log_sigma = values[1][..., : self.action_size]
        self._log_sigma_gradient = gradients[1][..., : self.action_size]
        self.critic = self.actor
        self._networks = [self.actor]
        if not is_shared:
            self.critic = Network(view, critic_layout, values[2], gradients[2], workspace="critic")
            self._networks.append(self.critic)

        self._optimizer = Adam(
            view,
            "policy",
            self._values,
            self._gradient,
            self.settings.learning_rate,
            _ADAM_EPSILON,
        )

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed: orthogonal matrices, log sigma 0."""
        for network in self._networks:
            *hidden, last = (layer.weight for layer in network.layers)
            for weight in hidden:
                _initialize_orthogonal(weight, math.sqrt(2), generator)

            if network is self.actor:
                _initialize_orthogonal(last[..., : self.action_size], 0.01, generator)
            if network is self.critic:
                _initialize_orthogonal(last[..., -1:], 1.0, generator)

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns (..., N, action_size + 2) sampled actions, their log likelihoods, and V(s)."""
        log_sigma = self.log_sigma.unsqueeze(-2)
        means, values = self._forward(observations, exact=True)
        actions = means + log_sigma.exp() * noise
        log_likelihoods = -0.5 * (noise.square() + _LOG_2_PI) - log_sigma
        return torch.cat([actions, sum_over_actions(log_likelihoods), values], dim=-1)

    def value(self, observations: Tensor) -> Tensor:
        """Returns V(s), (..., N, 1)."""
        return self.critic.forward(observations, exact=True)[..., -1:]

    def update(self, batch: Transitions) -> None:
        """Makes one update from a minibatch of N transitions.

        Minimizes L = -L^CLIP + vf_coef L^VF - ent_coef H over mu, V and log sigma. With
        l = log pi(a | s), r = exp(l - l_old) and sigma^2 the variance of pi:

            L^CLIP = 1/N sum min(r A, clip(r) A)      dL^CLIP / dl = r A / N if r A <= clip(r) A
            dl / dmu = (a - mu) / sigma^2             (otherwise 0: clip(r) is constant)
            dl / dlog sigma = (a - mu)^2 / sigma^2 - 1,   dH / dlog sigma = 1
            l and H are sums over the numbers of an action, each with its mu and sigma
            L^VF = 1/N sum (V - R)^2                  dL^VF / dV = 2 (V - R) / N, V unclipped
        """
        settings = self.settings
        size = batch.actions.shape[-2]
        advantages = batch.advantages
        if settings.normalize_advantage and size > 1:
            sd, mean = torch.std_mean(advantages, dim=-2, keepdim=True)
            advantages = (advantages - mean) / (sd + 1e-8)

        log_sigma = self.log_sigma.unsqueeze(-2)
        precision = torch.exp(-2 * log_sigma)
        means, values = self._forward(batch.observations)
        deviations = batch.actions - means
        squares = deviations.square() * precision
        log_likelihoods = sum_over_actions(-0.5 * (squares + _LOG_2_PI) - log_sigma)
        ratios = torch.exp(log_likelihoods - batch.log_likelihoods)
        clipped = ratios.clamp(1 - settings.clip_range, 1 + settings.clip_range)
        surrogates = advantages * ratios
        bounded = advantages * clipped
        by_log_likelihood = torch.where(surrogates <= bounded, surrogates, 0) / -size
        by_mean = by_log_likelihood * deviations * precision
        by_log_sigma = (by_log_likelihood * (squares - 1)).sum(dim=-2) - settings.ent_coef
        self._log_sigma_gradient.copy_(by_log_sigma)

        errors, by_value = self._value_errors(values, batch)
        by_value = by_value * (2 * settings.vf_coef / size)
        if self.actor is self.critic:
            self.actor.backward(torch.cat([by_mean, by_value], dim=-1))
        else:
            self.actor.backward(by_mean)
            self.critic.backward(by_value)

        self._record_loss("policy_loss", -torch.minimum(surrogates, bounded))
        self._record_loss("value_loss", errors.square())
        self._record_loss("entropy_loss", sum_over_actions(-0.5 * (1 + _LOG_2_PI) - log_sigma))

        # Clip the norm of the whole gradient, and make a step.
        norm = torch.linalg.vector_norm(self._gradient, dim=-1, keepdim=True)
        scale = (settings.max_grad_norm / (norm + 1e-6)).clamp_(max=1)
        # Seeds share this buffer, and its padding must stay 0 even if a diverged seed's norm is
        # nan.
        self._gradient.mul_(scale.nan_to_num_())
        self._optimizer.step()

    def _value_errors(self, values: Tensor, batch: Transitions) -> tuple[Tensor, Tensor]:
        """Returns errors of V(s) and half the derivatives of their squares by V(s), (..., N, 1).

        L^VF is 1/N sum errors^2; V(s) may be clipped to within `clip_range_vf` of its old value.
        """
        errors = values - batch.returns
        clip = self.settings.clip_range_vf
        if clip is None:
            return errors, errors
        changes = values - batch.values
        clipped_changes = changes.clamp(-clip, clip)
        clipped = batch.values + clipped_changes - batch.returns
        is_within = clipped_changes == changes
        if self.settings.value_loss == "clipped":
            return clipped, torch.where(is_within, clipped, 0)
        # The larger error counts; a clipped error does not depend on V(s).
        is_larger = errors.abs() >= clipped.abs()
        return (
            torch.where(is_larger, errors, clipped),
            torch.where(is_larger | is_within, errors, 0),
        )

    def _forward(self, observations: Tensor, *, exact: bool = False) -> tuple[Tensor, Tensor]:
        """Returns mu(s), (..., N, action_size), and V(s), (..., N, 1)."""
        outputs = [network.forward(observations, exact=exact) for network in self._networks]
        return outputs[0][..., : self.action_size], outputs[-1][..., -1:]


def _initialize_orthogonal(weight: Tensor, gain: float, generator: Generator) -> None:
    """Draws a weight matrix of one seed on the CPU (Saxe et al., 2014)."""
    values = torch.empty(weight.shape, dtype=weight.dtype)
    weight.copy_(torch.nn.init.orthogonal_(values, gain, generator=generator))
