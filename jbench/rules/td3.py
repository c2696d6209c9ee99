"""Twin delayed DDPG (Fujimoto et al., 2018, Algorithm 1)."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule
from jbench.rules.networks import mlp
from jbench.settings.algorithms import TD3Settings


class TD3(Rule):
    """TD3: DDPG with the lower value of two critics, smoothed target actions and a delayed actor.

    Attributes:
        actor: the policy; tanh of its outputs (N, action_size) is the action.
        critics: each returns values (N, 1) of observations and actions
            (N, observation_size + action_size). There may be more than two.
    """

    Settings = TD3Settings
    bases = TD3Settings.bases
    losses: Mapping[str, str] = {"critic_loss": "critics", "actor_loss": "actor"}
    targets = ("actor", "critics")
    delayed = ("actor", "actor_target", "critics_target")

    settings: TD3Settings
    actor_target: nn.Module
    critics_target: nn.ModuleList

    def __init__(self, settings: TD3Settings, observation_size: int, action_size: int = 1) -> None:
        """See `Rule`."""
        super().__init__(settings, observation_size, action_size)
        self.noise_per_transition = action_size

        self.actor = self.make_actor()
        self.critics = nn.ModuleList([self.make_critic(), self.make_critic()])

    def make_actor(self) -> nn.Sequential:
        """Returns an untrained policy, which ends in a Linear layer of action_size outputs."""
        sizes = (self.observation_size, *self.settings.hidden_layers, self.action_size)
        return mlp(sizes, self.settings.initialization)

    def make_critic(self) -> nn.Module:
        """Returns an untrained critic, from (N, observation_size + action_size) to (N, 1)."""
        sizes = (self.observation_size + self.action_size, *self.settings.hidden_layers, 1)
        return mlp(sizes, self.settings.initialization)

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update changes the actor and the target networks."""
        return update % self.settings.policy_delay == 0

    def target_values(self, batch: Batch) -> Tensor:
        """Returns r + gamma min Q'_i(s', pi'(s') + clip(noise, -c, c)), (N, 1)."""
        clip = self.settings.target_noise_clip
        noise = self.settings.target_policy_noise * batch.noise
        next_actions = self.actor_target(batch.next_observations).tanh() + noise.clamp(-clip, clip)

        next_actions = next_actions.clamp(-1, 1)
        next_state_actions = torch.cat([batch.next_observations, next_actions], dim=-1)
        next_values = [critic(next_state_actions) for critic in self.critics_target]
        lowest: Tensor = torch.stack(next_values).amin(0)
        return batch.rewards + batch.discounts * lowest

    def critic_loss(self, batch: Batch) -> Tensor:
        """Returns the sum of the mean squared errors of the critics."""
        targets = self.target_values(batch)
        values = torch.stack([critic(batch.state_actions) for critic in self.critics])
        return (values - targets).square().mean(dim=1).sum()

    def actor_loss(self, batch: Batch) -> Tensor:
        """Returns minus the mean value of the policy's actions, by the first critic."""
        actions = self.act(batch.observations)
        state_actions = torch.cat([batch.observations, actions], dim=-1)
        values: Tensor = self.critics[0](state_actions)
        return -values.mean()
