"""Deep deterministic policy gradient (Lillicrap et al., 2015, Algorithm 1)."""

import torch

from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.network import Layout
from jbench.agents.batched.replay import Batch
from jbench.settings.algorithms import DDPGSettings


class DDPGLearner(OffPolicyLearner[DDPGSettings]):
    """DDPG, for one seed or for a stack."""

    losses = ("actor_loss", "critic_loss")
    noise_per_transition = 0

    def _make_networks(self) -> None:
        """See `Learner._make_networks`."""
        # Only the actor's activations must outlive a forward pass of another network.
        self.actor = self._network("actor", self.policy_layout, workspace="actor")
        (self.critic,) = self._critics(["critic"], ["critic"])
        self.actor_target = self._network("actor_target", self.policy_layout, "critic")
        (self.critic_target,) = self._critics(["critic_target"], ["critic"])

    @property
    def critic_layout(self) -> Layout:
        """Layout of the critic; the settings say which layer takes the action."""
        return super().critic_layout._replace(joins=self.settings.action_layer)

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Makes one update from a minibatch of N transitions (s, a, r, s').

        Gradients, with y = r + gamma Q'(s', mu'(s')) held constant and a = tanh(u), u = actor(s):

            L_Q  = 1/N sum (Q(s, a) - y)^2        dL_Q / dQ  = 2 (Q(s, a) - y) / N
            L_mu = -1/N sum Q(s, mu(s))           dL_mu / da = -1/N dQ(s, a) / da
                                                  dL_mu / du = dL_mu / da (1 - a^2)

        `backward` continues from the network outputs, dQ and du, to the parameters.
        """
        settings = self.settings
        # y = r + gamma Q'(s', mu'(s')). The next actions are columns of `next_state_actions`, and
        # the actions of `state_actions`.
        torch.tanh(self.actor_target.forward(batch.next_observations), out=batch.next_actions)
        next_values = self.critic_target.forward(batch.next_state_actions)
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Minimize L_Q over the critic.
        errors = self.critic.forward(batch.state_actions) - targets
        self.critic.backward(2 * errors * batch.mean_weight)
        if not settings.gradients_first:
            self.critic.step()

        # Minimize L_mu over the actor.
        torch.tanh(self.actor.forward(batch.observations), out=batch.actions)
        losses = -self.critic.forward(batch.state_actions)
        by_action = self.critic.action_gradient(-batch.mean_weight)
        self.actor.backward(torch.ops.aten.tanh_backward(by_action, batch.actions))
        if settings.gradients_first:
            self.critic.step()
        self.actor.step()

        self._update_targets(settings.tau)

        self._record_loss("critic_loss", errors.square())
        self._record_loss("actor_loss", losses)
