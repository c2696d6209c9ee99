"""SAC with autograd and a learned temperature (Haarnoja et al., 2018b, Algorithm 1)."""

import copy
from functools import partial

import torch

from tests.agents.plain_ddpg import Network, polyak_update
from tests.agents.plain_td3 import minimize, values


class PlainSAC:
    """SAC's networks and its update."""

    def __init__(self, settings, observation_size, action_size=1):
        self.settings, self.action_size = settings, action_size
        units = (observation_size, *settings.hidden_layers)
        # The actor's outputs are mu(s) and log sigma(s).
        self.actor = Network((*units, 2 * action_size)).double()
        self.critics = torch.nn.ModuleList(
            Network((*units, 1), 0, action_size).double() for _ in range(2)
        )
        self.critic_targets = copy.deepcopy(self.critics)
        self.log_temperature = torch.zeros(1, dtype=torch.float64, requires_grad=True)
        adam = partial(torch.optim.Adam, lr=settings.learning_rate)
        self.actor_adam = adam(self.actor.parameters())
        self.critic_adam = adam(self.critics.parameters())
        self.temperature_adam = adam([self.log_temperature])

    def update(self, batch):
        """Makes one update from a minibatch."""
        temperature = self.log_temperature.exp().detach()
        noise, next_noise = batch.noise.chunk(2, dim=-1)
        with torch.no_grad():
            actions, log_likelihoods = self.sample(batch.next_observations, next_noise)
            next_values = values(self.critic_targets, batch.next_observations, actions).amin(0)
            soft_values = next_values - temperature * log_likelihoods
            targets = batch.rewards + batch.discounts * soft_values
        errors = values(self.critics, batch.observations, batch.actions) - targets
        minimize(0.5 * errors.square().mean(1).sum(), self.critic_adam)
        actions, log_likelihoods = self.sample(batch.observations, noise)
        action_values = values(self.critics, batch.observations, actions).amin(0)
        minimize((temperature * log_likelihoods - action_values).mean(), self.actor_adam)
        excess = (log_likelihoods.detach() - self.action_size).mean()
        minimize(-(self.log_temperature * excess).sum(), self.temperature_adam)
        polyak_update(self.critic_targets, self.critics, self.settings.tau)

    def sample(self, observations, noise):
        """Returns actions tanh(mu + sigma noise) and their log likelihoods (N, 1)."""
        mean, log_sigma = self.actor(observations).chunk(2, dim=-1)
        normal = torch.distributions.Normal(mean, log_sigma.clamp(-20, 2).exp())
        raw = mean + normal.stddev * noise
        actions = raw.tanh()
        log_likelihoods = normal.log_prob(raw) - torch.log(1 - actions.square() + 1e-6)
        return actions, log_likelihoods.sum(dim=1, keepdim=True)
