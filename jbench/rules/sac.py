"""Soft actor-critic with a learned temperature (Haarnoja et al., 2018b, Algorithm 1)."""

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule
from jbench.rules.networks import mlp
from jbench.settings.algorithms import SACSettings

MIN_LOG_SIGMA = -20
"""Least log sigma(s), as in the authors' code."""

MAX_LOG_SIGMA = 2
"""Largest log sigma(s), as in the authors' code."""

_EPSILON = 1e-6
"""Keeps the logarithm of tanh's derivative finite at actions of 1 and -1."""


class SAC(Rule):
    """SAC: a stochastic policy that is rewarded for its entropy, and two critics of it.

    Attributes:
        actor: mu(s) and log sigma(s) of the policy, (N, 2 action_size).
        critics: each returns values (N, 1) of observations and actions
            (N, observation_size + action_size). There may be more than two.
        log_temperature: logarithm of the weight alpha of the entropy, (1,).
    """

    Settings = SACSettings
    bases = SACSettings.bases
    losses: Mapping[str, str] = {
        "critic_loss": "critics",
        "actor_loss": "actor",
        "temperature_loss": "log_temperature",
    }
    # Both losses are those of one sample of actions, and of one temperature.
    gradients_first = ("actor_loss", "temperature_loss")
    targets = ("critics",)
    delayed = ("critics_target",)

    settings: SACSettings
    critics_target: nn.ModuleList

    def __init__(self, settings: SACSettings, observation_size: int, action_size: int = 1) -> None:
        """See `Rule`."""
        super().__init__(settings, observation_size, action_size)
        self.noise_per_transition = 2 * action_size
        self.target_entropy = -float(action_size)
        if settings.target_entropy != "auto":
            self.target_entropy = settings.target_entropy

        self.actor = self.make_actor()
        self.critics = nn.ModuleList([self.make_critic(), self.make_critic()])

        temperature = 1.0
        if settings.ent_coef != "auto":
            temperature = settings.ent_coef
            self.losses = {name: of for name, of in self.losses.items() if of != "log_temperature"}
        self.log_temperature = nn.Parameter(torch.full((1,), temperature).log())

    def make_actor(self) -> nn.Sequential:
        """Returns an untrained policy, which ends in a Linear layer of 2 action_size outputs."""
        return mlp((self.observation_size, *self.settings.hidden_layers, 2 * self.action_size))

    def make_critic(self) -> nn.Module:
        """Returns an untrained critic, from (N, observation_size + action_size) to (N, 1)."""
        return mlp((self.observation_size + self.action_size, *self.settings.hidden_layers, 1))

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update changes the target networks."""
        return update_of_call % self.settings.target_update_interval == 0

    def sample(self, observations: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Samples actions a = tanh(mu(s) + sigma(s) noise) from the policy.

        Args:
            observations: (N, observation_size).
            noise: (N, action_size) standard normal numbers.

        Returns:
            The actions (N, action_size), and log pi(a | s), (N, 1).
        """
        mean, log_sigma = self.actor(observations).chunk(2, dim=-1)
        log_sigma = log_sigma.clamp(MIN_LOG_SIGMA, MAX_LOG_SIGMA)
        actions = torch.tanh(mean + log_sigma.exp() * noise)

        log_normal = -0.5 * noise.square() - log_sigma - 0.5 * math.log(2 * math.pi)
        log_slope = torch.log(1 - actions.square() + _EPSILON)
        return actions, (log_normal - log_slope).sum(dim=-1, keepdim=True)

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """See `Rule`: actions that are sampled from the policy."""
        return self.sample(observations, noise)[0]

    def target_values(self, batch: Batch) -> Tensor:
        """Returns r + gamma (min Q'_i(s', a') - alpha log pi(a' | s')) of sampled a', (N, 1)."""
        noise = batch.noise[:, self.action_size :]
        next_actions, log_likelihoods = self.sample(batch.next_observations, noise)
        next_state_actions = torch.cat([batch.next_observations, next_actions], dim=-1)

        next_values = [critic(next_state_actions) for critic in self.critics_target]
        entropy = -self.log_temperature.exp() * log_likelihoods
        return batch.rewards + batch.discounts * (torch.stack(next_values).amin(0) + entropy)

    def critic_loss(self, batch: Batch) -> Tensor:
        """Returns half the sum of the mean squared errors of the critics."""
        targets = self.target_values(batch)
        values = torch.stack([critic(batch.state_actions) for critic in self.critics])
        return 0.5 * (values - targets).square().mean(dim=1).sum()

    def actor_loss(self, batch: Batch) -> Tensor:
        """Returns the mean of alpha log pi(a | s) - min Q_i(s, a) of sampled a."""
        noise = batch.noise[:, : self.action_size]
        actions, log_likelihoods = self.sample(batch.observations, noise)
        state_actions = torch.cat([batch.observations, actions], dim=-1)
        values = [critic(state_actions) for critic in self.critics]
        return (self.log_temperature.exp() * log_likelihoods - torch.stack(values).amin(0)).mean()

    def temperature_loss(self, batch: Batch) -> Tensor:
        """Returns minus log alpha times the mean of log pi(a | s) + the target entropy."""
        noise = batch.noise[:, : self.action_size]
        _, log_likelihoods = self.sample(batch.observations, noise)
        return -(self.log_temperature * (log_likelihoods + self.target_entropy)).mean()
