"""Deep deterministic policy gradient (Lillicrap et al., 2015, Algorithm 1)."""

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
from jbench.settings.algorithms import DDPGSettings


class DDPG(OffPolicyLearner):
    """DDPG, for one seed or for a stack."""

    losses: ClassVar[tuple[str, ...]] = ("actor_loss", "critic_loss")
    noise_per_transition = 0

    def __init__(
        self,
        settings: DDPGSettings,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
    ) -> None:
        """As for any learner."""
        super().__init__(settings, observation_size, part, low_precision)
        self._settings, joins = settings, settings.action_layer
        # The actor's activations are needed until its gradient, those of the others before.
        self.actor = self._network("actor", self.policy_sizes, workspace="actor")
        (self.critic,) = self._critics(["critic"], ["critic"], joins=joins)
        self.actor_target = self._network(
            "actor_target", self.policy_sizes, "critic", learned=False
        )
        (self.critic_target,) = self._critics(["critic_target"], ["critic"], False, joins)
        self._actor_adam = self._adam("actor", self.actor)
        self._critic_adam = self._adam("critic", self.critic)

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed."""
        kind, bound = self._settings.initialization, self._settings.last_layer_bound
        for network, target in ((self.actor, self.actor_target), (self.critic, self.critic_target)):
            initialize_uniform(network.layers, generator, kind, bound)
            target.values.copy_(network.values)

    def act(self, observations: Tensor) -> Tensor:
        """Returns mu(s)."""
        return self.actor.forward(observations, exact=True).tanh_()

    def policy(self) -> tuple[Network, str]:
        """As `Learner.policy`."""
        return self.actor, "tanh"

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Learns from a minibatch of N transitions (s, a, r, s'), always in the same way."""
        settings = self._settings
        # y = r + gamma Q'(s', mu'(s'))
        torch.tanh(self.actor_target.forward(batch.next_observations), out=batch.next_actions)
        next_values = self.critic_target.forward(batch.next_state_actions)
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Update the critic by minimising the loss 1/N sum (y - Q(s, a))^2.
        errors = self.critic.forward(batch.state_actions) - targets
        self.critic.backward(2 * errors * batch.share)
        if not settings.gradients_first:
            self._critic_adam.step()

        # Update the actor by the policy gradient, the gradient of 1/N sum Q(s, mu(s)).
        torch.tanh(self.actor.forward(batch.observations), out=batch.actions)
        losses = -self.critic.forward(batch.state_actions)
        descent = self.critic.action_gradient(-batch.share)
        self.actor.backward(tanh_gradient(descent, batch.actions))
        if settings.gradients_first:
            self._critic_adam.step()
        self._actor_adam.step()

        # Update the target networks.
        polyak_update(self.critic_target, self.critic, settings.tau)
        polyak_update(self.actor_target, self.actor, settings.tau)

        self._record_loss("critic_loss", errors.square())
        self._record_loss("actor_loss", losses)
