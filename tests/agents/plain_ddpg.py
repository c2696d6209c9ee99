"""DDPG with autograd (Lillicrap et al., 2015, Algorithm 1), to compare jbench's own with."""

import copy
import itertools

import torch
from torch import nn


class Network(nn.Module):
    """Layers of ReLU units; the layer `action_layer` takes the actions as extra inputs."""

    def __init__(self, units, action_layer=None, action_size=1):
        super().__init__()
        self.action_layer = action_layer
        self.layers = nn.ModuleList(
            nn.Linear(inputs + (action_size if i == action_layer else 0), outputs)
            for i, (inputs, outputs) in enumerate(itertools.pairwise(units))
        )

    def forward(self, values, actions=None):
        for i, layer in enumerate(self.layers):
            if i > 0:
                values = values.relu()
            if i == self.action_layer:
                values = torch.cat([values, actions], dim=-1)
            values = layer(values)
        return values


class PlainDDPG:
    """DDPG's networks and its update."""

    def __init__(self, settings, observation_size, action_size=1):
        units = (observation_size, *settings.hidden_layers)
        actor = Network((*units, action_size))
        self.make(settings, actor, Network((*units, 1), settings.action_layer, action_size))

    def make(self, settings, actor, critic):
        """Makes targets and optimizers of the networks."""
        self.settings, self.actor, self.critic = settings, actor.double(), critic.double()
        self.actor_target, self.critic_target = copy.deepcopy((self.actor, self.critic))
        self.actor_adam, self.critic_adam = (
            torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
            for network in (self.actor, self.critic)
        )

    def act(self, actor, observations):
        return actor(observations).tanh()

    def value(self, critic, observations, actions):
        return critic(observations, actions)

    def update(self, batch):
        """Makes one update from a minibatch."""
        with torch.no_grad():
            next_actions = self.act(self.actor_target, batch.next_observations)
            next_values = self.value(self.critic_target, batch.next_observations, next_actions)
            targets = batch.rewards + batch.discounts * next_values
        values = self.value(self.critic, batch.observations, batch.actions)
        critic_loss = (values - targets).square().mean()
        critic_gradients = torch.autograd.grad(critic_loss, list(self.critic.parameters()))
        if not self.settings.gradients_first:
            _step(self.critic, self.critic_adam, critic_gradients)
        actions = self.act(self.actor, batch.observations)
        actor_loss = -self.value(self.critic, batch.observations, actions).mean()
        actor_gradients = torch.autograd.grad(actor_loss, list(self.actor.parameters()))
        if self.settings.gradients_first:
            _step(self.critic, self.critic_adam, critic_gradients)
        _step(self.actor, self.actor_adam, actor_gradients)
        polyak_update(self.actor_target, self.actor, self.settings.tau)
        polyak_update(self.critic_target, self.critic, self.settings.tau)


def polyak_update(target, network, tau):
    for old, new in zip(target.parameters(), network.parameters(), strict=True):
        old.data.lerp_(new.data, tau)


def _step(network, adam, gradients):
    for parameter, gradient in zip(network.parameters(), gradients, strict=True):
        parameter.grad = gradient
    adam.step()
