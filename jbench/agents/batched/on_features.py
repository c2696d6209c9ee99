"""The off-policy update rules on features learned with the agent.

The rules themselves do not change: z_o replaces the observations in their minibatch, and their
critics take z_oa (`FeatureCritic`).
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from torch import Generator, Tensor

from jbench.agents.batched.features import Features
from jbench.agents.batched.layers import Affine
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.tensors import Tensors
from jbench.policies.layers import Linear, SavedLayer
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import OffPolicySettings
from jbench.settings.records import OFESettings


class OnFeatures(OffPolicyLearner[OffPolicySettings]):
    """Mixin that trains features and passes them to an update rule.

    Target networks use the current features too. The agent's gradients do not change the features,
    which are computed in full precision.
    """

    def __init__(
        self,
        settings: OffPolicySettings,
        observation_size: int,
        action_size: int,
        view: Tensors,
        *,
        ofe: OFESettings,
    ) -> None:
        self.features = Features(ofe, observation_size, action_size, view)
        self.pretraining = ofe.pretraining
        self.losses = (*self.losses, "prediction_loss")
        super().__init__(settings, self.features.size, action_size, view)

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        super().initialize(generator)
        self.features.initialize(generator)

    def act(self, observations: Tensor) -> Tensor:
        """See `Learner.act`."""
        return super().act(self._encode(observations))

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """See `OffPolicyLearner.explore`."""
        return super().explore(self._encode(observations), noise)

    def policy_layers(self) -> list[Affine]:
        """See `Learner.policy_layers`; those of the features come first."""
        return [*self.features.observation_layers, *super().policy_layers()]

    def feature_layers(self, linear: Sequence[Linear]) -> list[SavedLayer]:
        """See `Learner.feature_layers`."""
        return self.features.saved_layers(linear)

    def load_policy(self, policy: SavedNetwork) -> None:
        """See `Learner.load_policy`."""
        super().load_policy(policy)
        self.features.load_standardization(policy.layers)

    def pretrain(self, batch: Batch) -> None:
        """See `OffPolicyLearner.pretrain`."""
        self.features.learn(batch)

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Updates the features, then the agent on the new features of the same minibatch."""
        self._record_loss("prediction_loss", self.features.learn(batch))
        super().update(self._on_features(batch), delayed)

    def _encode(self, observations: Tensor) -> Tensor:
        """Returns z_o of observations, in a buffer."""
        out = self.view.scratch("features", observations.shape[-2], self.features.size)
        return self.features.observation_features(observations, out)

    def _on_features(self, batch: Batch) -> Batch:
        """Returns a minibatch of z_o, in buffers of its own, with the other columns of another."""
        shape = batch.rows.shape[-2], self.features.size + self.action_size + 1
        rows = self.view.scratch("s on features", *shape)
        next_rows = self.view.scratch("s' on features", *shape)
        encoded = Batch(rows, next_rows, batch.discounts, batch.noise, self.action_size)
        actions_and_reward = slice(-self.action_size - 1, None)
        encoded.rows[..., actions_and_reward].copy_(batch.rows[..., actions_and_reward])
        self.features.observation_features(batch.observations, encoded.observations)
        self.features.observation_features(batch.next_observations, encoded.next_observations)
        return encoded

    @property
    def critic_layout(self) -> Layout:
        """Layout of a critic of z_oa."""
        inputs = self.features.state_action_size
        after_state = inputs - self.features.size  # the columns of z_oa that depend on the action
        return Layout((inputs, *self.policy_layout.sizes[1:-1], 1), after_state)

    def _critics(self, names: Sequence[str], workspaces: Sequence[str]) -> list[Network]:
        """Returns critics of z_oa, which the first one computes for all."""
        critics: list[Network] = []
        first: Network | None = None
        for name, workspace in zip(names, workspaces, strict=True):
            make = partial(FeatureCritic, self.features, first)
            critics.append(self._network(name, self.critic_layout, workspace, make))
            first = critics[0]
        return critics


class FeatureCritic(Network):
    """A critic of z_oa whose argument is z_o and an action."""

    def __init__(
        self, features: Features, twin: Network | None, *args: Any, **options: Any
    ) -> None:
        """Makes a critic that computes z_oa, or takes that of a twin evaluated before it."""
        super().__init__(*args, **options)
        self._features = features
        self._twin = twin

    def forward(self, inputs: Tensor, *, exact: bool = False) -> Tensor:
        """Returns values (..., batch, 1) for z_o and actions (..., batch, size + dim(A))."""
        if self._twin is None:
            features = self._features.state_action_features(inputs)
        else:
            features = self._twin.inputs
        return super().forward(features, exact=exact)

    def action_gradient(self, delta: Tensor, rows: Tensor | None = None) -> Tensor:
        """Returns the gradient (..., batch, dim(A)) by the actions; see `Network`."""
        return self._features.action_gradient(super().action_gradient(delta, rows), rows)
