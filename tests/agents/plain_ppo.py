"""PPO with autograd (Schulman et al., 2017, Algorithm 1), to compare jbench's own with."""

import itertools

import torch
from torch import nn


class PlainPPO(nn.Module):
    """PPO's networks, its loss and its step."""

    def __init__(self, settings, observation_size, action_size=1):
        super().__init__()
        self.settings = settings
        units = (observation_size, *settings.hidden_layers)
        self.policy_layers = _hidden(units)
        self.value_layers = self.policy_layers if settings.shared_layers else _hidden(units)
        self.mean, self.value = nn.Linear(units[-1], action_size), nn.Linear(units[-1], 1)
        self.log_sigma = nn.Parameter(torch.zeros(action_size))
        self.double()
        self.adam = torch.optim.Adam(self.parameters(), lr=settings.learning_rate, eps=1e-5)

    def update(self, batch):
        """Makes one step on a minibatch."""
        settings = self.settings
        loss = self._policy_loss(batch) + settings.vf_coef * self._value_loss(batch)
        entropy = torch.distributions.Normal(0, self.log_sigma.exp()).entropy().sum()
        self.adam.zero_grad()
        (loss - settings.ent_coef * entropy).backward()
        nn.utils.clip_grad_norm_(self.parameters(), settings.max_grad_norm)
        self.adam.step()

    def _policy_loss(self, batch):
        policy = torch.distributions.Normal(
            self.mean(self.policy_layers(batch.observations)), self.log_sigma.exp()
        )
        advantages = batch.advantages
        if self.settings.normalize_advantage:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        log_likelihoods = policy.log_prob(batch.actions).sum(dim=1, keepdim=True)
        ratios = (log_likelihoods - batch.log_likelihoods).exp()
        clipped = ratios.clamp(1 - self.settings.clip_range, 1 + self.settings.clip_range)
        return -torch.minimum(ratios * advantages, clipped * advantages).mean()

    def _value_loss(self, batch):
        values = self.value(self.value_layers(batch.observations))
        clip = self.settings.clip_range_vf
        unclipped = (values - batch.returns).square()
        if clip is None:
            return unclipped.mean()
        near = batch.values + (values - batch.values).clamp(-clip, clip)
        clipped = (near - batch.returns).square()
        if self.settings.value_loss == "clipped":
            return clipped.mean()
        return torch.maximum(unclipped, clipped).mean()


def _hidden(units):
    layers = [(nn.Linear(*pair), nn.ReLU()) for pair in itertools.pairwise(units)]
    return nn.Sequential(*itertools.chain.from_iterable(layers))
