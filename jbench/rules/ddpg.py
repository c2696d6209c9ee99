"""Deep deterministic policy gradient (Lillicrap et al., 2015, Algorithm 1)."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from jbench.agents.batched.replay import Batch
from jbench.agents.batched.rule import Rule
from jbench.rules.networks import JoiningCritic, mlp
from jbench.settings.algorithms import DDPGSettings


class DDPG(Rule):
    """DDPG: a critic of the policy's actions, and a policy that climbs it.

    Attributes:
        actor: the policy; tanh of its outputs (N, action_size) is the action.
        critic: values (N, 1) of observations and actions (N, observation_size + action_size).
    """

    Settings = DDPGSettings
    bases = DDPGSettings.bases
    losses: Mapping[str, str] = {"critic_loss": "critic", "actor_loss": "actor"}
    targets = ("actor", "critic")

    settings: DDPGSettings
    actor_target: nn.Module
    critic_target: nn.Module

    def __init__(self, settings: DDPGSettings, observation_size: int, action_size: int = 1) -> None:
        """See `Rule`."""
        super().__init__(settings, observation_size, action_size)
        if settings.gradients_first:
            self.gradients_first = ("critic_loss", "actor_loss")

        self.actor = self.make_actor()
        self.critic = self.make_critic()

    def make_actor(self) -> nn.Sequential:
        """Returns an untrained policy, which ends in a Linear layer of action_size outputs."""
        settings = self.settings
        sizes = (self.observation_size, *settings.hidden_layers, self.action_size)
        return mlp(sizes, settings.initialization, settings.last_layer_bound)

    def make_critic(self) -> nn.Module:
        """Returns an untrained critic, from (N, observation_size + action_size) to (N, 1)."""
        settings = self.settings
        sizes = (self.observation_size, *settings.hidden_layers, 1)
        return JoiningCritic(
            sizes,
            self.action_size,
            settings.action_layer,
            settings.initialization,
            settings.last_layer_bound,
        )

    def target_values(self, batch: Batch) -> Tensor:
        """Returns r + gamma Q'(s', mu'(s')), (N, 1)."""
        next_actions = self.actor_target(batch.next_observations).tanh()
        next_state_actions = torch.cat([batch.next_observations, next_actions], dim=-1)
        next_values: Tensor = self.critic_target(next_state_actions)
        return batch.rewards + batch.discounts * next_values

    def critic_loss(self, batch: Batch) -> Tensor:
        """Returns the mean squared error of the critic."""
        errors: Tensor = self.critic(batch.state_actions) - self.target_values(batch)
        return errors.square().mean()

    def actor_loss(self, batch: Batch) -> Tensor:
        """Returns minus the mean value of the policy's actions."""
        actions = self.act(batch.observations)
        state_actions = torch.cat([batch.observations, actions], dim=-1)
        values: Tensor = self.critic(state_actions)
        return -values.mean()
