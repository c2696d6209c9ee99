"""TD3 with autograd (Fujimoto et al., 2018, Algorithm 1), to compare jbench's own with."""

import copy

import torch

from tests.agents.plain_ddpg import Network, polyak_update


class PlainTD3:
    """TD3's networks and its update."""

    def __init__(self, settings, observation_size, action_size=1):
        self.settings = settings
        units = (observation_size, *settings.hidden_layers)
        self.actor = Network((*units, action_size)).double()
        self.critics = torch.nn.ModuleList(
            Network((*units, 1), 0, action_size).double() for _ in range(2)
        )
        self.actor_target, self.critic_targets = copy.deepcopy((self.actor, self.critics))
        rate = settings.learning_rate
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), lr=rate)
        self.critic_adam = torch.optim.Adam(self.critics.parameters(), lr=rate)

    def update(self, batch, delayed):
        """Makes one update from a minibatch; actor and targets are updated only if `delayed`."""
        settings = self.settings
        with torch.no_grad():
            clip = settings.target_noise_clip
            noise = (settings.target_policy_noise * batch.noise).clamp(-clip, clip)
            next_actions = self.actor_target(batch.next_observations).tanh() + noise
            next_actions = next_actions.clamp(-1, 1)
            next_values = values(self.critic_targets, batch.next_observations, next_actions)
            targets = batch.rewards + batch.discounts * next_values.amin(0)
        errors = values(self.critics, batch.observations, batch.actions) - targets
        minimize(errors.square().mean(1).sum(), self.critic_adam)
        if delayed:
            actions = self.actor(batch.observations).tanh()
            minimize(-self.critics[0](batch.observations, actions).mean(), self.actor_adam)
            polyak_update(self.actor_target, self.actor, settings.tau)
            polyak_update(self.critic_targets, self.critics, settings.tau)


def values(critics, observations, actions):
    """Returns the values (2, N, 1) of two critics."""
    return torch.stack([critic(observations, actions) for critic in critics])


def minimize(loss, adam):
    adam.zero_grad()
    loss.backward()
    adam.step()
