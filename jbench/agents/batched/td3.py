"""Twin delayed DDPG (Fujimoto et al., 2018, Algorithm 1)."""

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Generator, Tensor

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.learner import (
    OffPolicyLearner,
    initialize_uniform,
    polyak_update,
    tanh_gradient,
)
from jbench.agents.batched.network import Network
from jbench.agents.batched.tensors import Part
from jbench.settings.algorithms import TD3Settings


class TD3(OffPolicyLearner):
    """TD3, for one seed or for a stack."""

    losses: ClassVar[tuple[str, ...]] = ("actor_loss", "critic_loss")
    noise_per_transition = 1

    def __init__(
        self,
        settings: TD3Settings,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
    ) -> None:
        """As for any learner."""
        super().__init__(settings, observation_size, part, low_precision)
        self._initialization = settings.initialization
        self._tau, self._delay = settings.tau, settings.policy_delay
        self._sigma, self._clip = settings.target_policy_noise, settings.target_noise_clip
        # The actor's activations are needed until its gradient, those of the others before.
        self.actor = self._network("actor", self.policy_sizes, workspace="actor")
        workspaces = ["critic"] * 2
        self.critics = self._critics(["critic1", "critic2"], workspaces)
        self.actor_target = self._network("actor_target", self.policy_sizes, "critic", False)
        self.critic_targets = self._critics(["critic1_target", "critic2_target"], workspaces, False)
        self._actor_adam = self._adam("actor", self.actor)
        self._critic_adams = [
            self._adam(f"critic{i}", critic) for i, critic in enumerate(self.critics, 1)
        ]

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed."""
        networks = (self.actor, *self.critics)
        targets = (self.actor_target, *self.critic_targets)
        for network, target in zip(networks, targets, strict=True):
            initialize_uniform(network.layers, generator, self._initialization)
            target.values.copy_(network.values)

    def act(self, observations: Tensor) -> Tensor:
        """Returns pi(s)."""
        return self.actor.forward(observations, exact=True).tanh_()

    def policy(self) -> tuple[Network, str]:
        """As `Learner.policy`."""
        return self.actor, "tanh"

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether actor and target networks are updated."""
        return update % self._delay == 0

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """As `Learner.reset_losses`: the actor's last loss stays until it has a new one."""
        self._noted[..., 0 if any(delayed) else 1 :, :].zero_()

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Learns from a minibatch of N transitions (s, a, r, s'); the actor if it is due."""
        # a' = pi'(s') + clip(noise, -c, c), y = r + gamma min Q'(s', a')
        smoothing = (batch.noise * self._sigma).clamp_(-self._clip, self._clip)
        next_actions = self.actor_target.forward(batch.next_observations).tanh_()
        torch.clamp(next_actions.add_(smoothing), -1, 1, out=batch.next_actions)
        next_values = torch.minimum(
            *(q.forward(batch.next_state_actions) for q in self.critic_targets)
        )
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Update the critics by minimising 1/N sum (y - Q(s, a))^2 for each of them.
        losses = torch.zeros_like(targets)
        for critic, adam in zip(self.critics, self._critic_adams, strict=True):
            errors = critic.forward(batch.state_actions) - targets
            critic.backward(2 * errors * batch.share)
            adam.step()
            losses.addcmul_(errors, errors)
        self._record_loss("critic_loss", losses)

        if delayed:
            # Update the actor by the policy gradient, the gradient of 1/N sum Q1(s, pi(s)).
            torch.tanh(self.actor.forward(batch.observations), out=batch.actions)
            values = self.critics[0].forward(batch.state_actions)
            descent = self.critics[0].action_gradient(-batch.share)
            self.actor.backward(tanh_gradient(descent, batch.actions))
            self._actor_adam.step()
            self._record_loss("actor_loss", -values)

            # Update the target networks.
            for target, critic in zip(self.critic_targets, self.critics, strict=True):
                polyak_update(target, critic, self._tau)
            polyak_update(self.actor_target, self.actor, self._tau)
