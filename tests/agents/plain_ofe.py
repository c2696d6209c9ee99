"""Learned features with autograd (Ota et al., 2020), and DDPG on them.

The tests compare it with `jbench/agents/batched/features.py`, whose gradients are hand-written and
harder to read.
"""

import copy

import torch
from torch import nn

from tests.agents.plain_ddpg import Network, PlainDDPG


class PlainFeatures(nn.Module):
    """phi_o, phi_oa and the layer that predicts the next observation."""

    def __init__(self, settings, size, action_size=1):
        super().__init__()
        self.settings, self.size = settings, size
        self.appended = settings.units > size
        self.feature_size = settings.units + (size if self.appended else 0)
        self.phi_o = self._layers(size)
        self.pair_size = self.feature_size + action_size
        self.phi_oa = self._layers(self.pair_size)
        self.head = nn.Linear(self.pair_size + settings.units, size)
        self.double()
        self.adam = torch.optim.Adam(self.parameters(), lr=settings.learning_rate)
        self.first = []  # minibatches that define mean and variance

    def _layers(self, inputs):
        layers = nn.ModuleList()
        for width in self.settings.widths:
            layers.append(nn.Linear(inputs, width))
            inputs += width
        return layers

    def linear_layers(self):
        return [*self.phi_o, *self.phi_oa, self.head]

    def standardized(self, observations):
        if not self.first:
            return observations.clamp(-10, 10) / (1 + 1e-6) ** 0.5
        rows = torch.cat(self.first)
        variance = rows.var(dim=0, correction=0)
        return ((observations - rows.mean(dim=0)) / (variance + 1e-6).sqrt()).clamp(-10, 10)

    def observation_features(self, observations):
        units = _dense(self.standardized(observations), self.phi_o)[:, self.size :]
        return torch.cat([observations, units], dim=1) if self.appended else units

    def state_action_features(self, features, actions):
        pairs = torch.cat([features, actions], dim=1)
        return torch.cat([pairs, self._dense_pairs(pairs)[:, self.pair_size :]], dim=1)

    def loss(self, batch):
        pairs = torch.cat([self.observation_features(batch.observations), batch.actions], dim=1)
        predicted = self.head(self._dense_pairs(pairs))
        return (predicted - self.standardized(batch.next_observations)).square().mean()

    def learn(self, batch):
        """Makes one update; returns the loss before it."""
        if len(self.first) < self.settings.standardize_updates:
            self.first.append(batch.observations.clone())
        self.adam.zero_grad()
        loss = self.loss(batch)
        loss.backward()
        self.adam.step()
        return float(loss.detach())

    def _dense_pairs(self, pairs):
        if self.appended:
            observations = self.standardized(pairs[:, : self.size])
            pairs = torch.cat([observations, pairs[:, self.size :]], dim=1)
        return _dense(pairs, self.phi_oa)


def _dense(values, layers):
    for layer in layers:
        values = torch.cat([values, nn.functional.silu(layer(values))], dim=1)
    return values


class OnFeatures(Network):
    """A network on features, whose parameters are not part of its own."""

    def __init__(self, features, units):
        super().__init__(units)
        self.features = [features]
        self.double()

    def __deepcopy__(self, memory):
        other = OnFeatures(self.features[0], (1, 1))
        other.layers = copy.deepcopy(self.layers, memory)
        return other

    def forward(self, observations, actions=None):
        features = self.features[0].observation_features(observations)
        if actions is not None:
            features = self.features[0].state_action_features(features, actions)
        return super().forward(features)


class PlainDDPGOnFeatures(PlainDDPG):
    """DDPG on learned features."""

    def __init__(self, settings, ofe, size, action_size=1):
        super().__init__(settings, size)
        self.features = features = PlainFeatures(ofe, size, action_size)
        hidden = settings.hidden_layers
        self.actor = OnFeatures(features, (features.feature_size, *hidden, action_size))
        self.critic = OnFeatures(features, (features.pair_size + ofe.units, *hidden, 1))
        self.actor_target, self.critic_target = copy.deepcopy((self.actor, self.critic))
        self.actor_adam, self.critic_adam = (
            torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
            for network in (self.actor, self.critic)
        )

    def update(self, batch):
        loss = self.features.learn(batch)
        super().update(batch)
        return loss
