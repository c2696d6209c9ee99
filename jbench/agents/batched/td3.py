"""Twin delayed DDPG (Fujimoto et al., 2018, Algorithm 1)."""

from collections.abc import Sequence

import torch

from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.replay import Batch
from jbench.settings.algorithms import TD3Settings


class TD3Learner(OffPolicyLearner[TD3Settings]):
    """TD3, for one seed or for a stack."""

    losses = ("actor_loss", "critic_loss")

    def _make_networks(self) -> None:
        """See `Learner._make_networks`."""
        self.noise_per_transition = self.action_size
        # Only the actor's activations must outlive a forward pass of another network.
        self.actor = self._network("actor", self.policy_layout, workspace="actor")
        self.critics = self._critics(["critic1", "critic2"], ["critic", "critic"])
        self.actor_target = self._network("actor_target", self.policy_layout, "critic")
        self.critic_targets = self._critics(
            ["critic1_target", "critic2_target"], ["critic", "critic"]
        )

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether actor and target networks are updated."""
        return update % self.settings.policy_delay == 0

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """See `Learner.reset_losses`; the actor's loss is kept until its next update."""
        for name, sums in self._sums_by_name.items():
            if name != "actor_loss" or any(delayed):
                sums.zero_()

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Makes one update from a minibatch of N transitions (s, a, r, s').

        With a' = pi'(s') + clip(noise, -c, c), y = r + gamma min Q'_i(s', a') constant, and
        pi(s) = a = tanh(u):

            L_Q  = sum_i 1/N sum (Q_i(s, a) - y)^2    dL_Q / dQ_i = 2 (Q_i(s, a) - y) / N
            L_pi = -1/N sum Q_1(s, pi(s))             dL_pi / du = -1/N dQ_1(s, a) / da (1 - a^2)

        The actor and the target networks are updated only if `delayed`.
        """
        settings = self.settings
        clip = settings.target_noise_clip
        smoothing = (batch.noise * settings.target_policy_noise).clamp_(-clip, clip)
        next_actions = self.actor_target.forward(batch.next_observations).tanh_()
        # The next actions are columns of `next_state_actions`, and the actions of `state_actions`.
        torch.clamp(next_actions.add_(smoothing), -1, 1, out=batch.next_actions)
        both = (critic.forward(batch.next_state_actions) for critic in self.critic_targets)
        next_values = torch.minimum(*both)
        targets = torch.addcmul(batch.rewards, batch.discounts, next_values)

        # Minimize L_Q over the critics.
        squared_errors = self._fit_critics(batch.state_actions, targets, scale=2)
        self._record_loss("critic_loss", squared_errors)

        if delayed:
            # Minimize L_pi over the actor.
            torch.tanh(self.actor.forward(batch.observations), out=batch.actions)
            critic = self.critics[0]
            values = critic.forward(batch.state_actions)
            by_action = critic.action_gradient(-batch.mean_weight)
            self.actor.backward(torch.ops.aten.tanh_backward(by_action, batch.actions))
            self.actor.step()
            self._record_loss("actor_loss", -values)
            self._update_targets(settings.tau)
