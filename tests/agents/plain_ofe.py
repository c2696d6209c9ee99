"""Learned features with autograd (Ota et al., 2020), and DDPG on them."""

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


class PlainDDPGOnFeatures(PlainDDPG):
    """DDPG on learned features."""

    def __init__(self, settings, ofe, size, action_size=1):
        self.features = features = PlainFeatures(ofe, size, action_size)
        hidden = settings.hidden_layers
        actor = Network((features.feature_size, *hidden, action_size))
        self.make(settings, actor, Network((features.pair_size + ofe.units, *hidden, 1)))

    def act(self, actor, observations):
        return super().act(actor, self.features.observation_features(observations))

    def value(self, critic, observations, actions):
        seen = self.features.observation_features(observations)
        return critic(self.features.state_action_features(seen, actions))

    def update(self, batch):
        loss = self.features.learn(batch)
        super().update(batch)
        return loss
