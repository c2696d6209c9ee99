"""The off-policy update rules on features learned with the agent.

The rules themselves do not change: z_o replaces the observations in their minibatch, and their
critics take z_oa (`features.FeatureCritic`).
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from torch import Generator, Tensor

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.features import FeatureCritic, Features
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3
from jbench.agents.batched.tensors import Tensors
from jbench.policies.network import SavedLayer
from jbench.settings.records import OFESettings

_LOSS = "prediction_loss"


class OnFeatures(OffPolicyLearner):
    """Mixin that trains features and passes them to an update rule.

    Target networks use the current features too. The agent's gradients do not change the features,
    which are computed in full precision.
    """

    def __init__(
        self,
        settings: Any,
        observation_size: int,
        action_size: int,
        view: Tensors,
        *,
        ofe: OFESettings,
    ) -> None:
        """See `Learner`."""
        self.features = Features(ofe, observation_size, action_size, view)
        self._pretraining = ofe.pretraining
        self._batches: dict[Batch, Batch] = {}
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

    def feature_layers(self) -> list[SavedLayer]:
        """See `Learner.feature_layers`."""
        return self.features.saved_layers()

    def load_feature_layers(self, layers: Sequence[SavedLayer]) -> None:
        """See `Learner.load_feature_layers`."""
        self.features.load_saved(layers)

    def pretraining(self, control_steps: int) -> int:
        """See `OffPolicyLearner.pretraining`."""
        return round(self._pretraining * control_steps)

    def pretrain(self, batch: Batch) -> None:
        """See `OffPolicyLearner.pretrain`."""
        self.features.learn(batch)

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Updates the features, then the agent on the new features of the same minibatch."""
        self._record_loss(_LOSS, self.features.learn(batch))
        super().update(self._on_features(batch), delayed)

    def _encode(self, observations: Tensor) -> Tensor:
        out = self.view.scratch("features", observations.shape[-2], self.features.size)
        return self.features.observation_features(observations, out)

    def _on_features(self, batch: Batch) -> Batch:
        """Returns the minibatch with features in place of observations."""
        if batch not in self._batches:
            shape = batch.rows.shape[-2], self.features.size + self.action_size + 1
            rows, next_rows = (self.view.scratch(f"{n} on features", *shape) for n in ("s", "s'"))
            self._batches[batch] = Batch(
                rows, next_rows, batch.discounts, batch.noise, self.action_size
            )
        encoded = self._batches[batch]
        actions_and_reward = slice(-self.action_size - 1, None)
        encoded.rows[..., actions_and_reward].copy_(batch.rows[..., actions_and_reward])
        self.features.observation_features(batch.observations, encoded.observations)
        self.features.observation_features(batch.next_observations, encoded.next_observations)
        return encoded

    @property
    def critic_layout(self) -> Layout:
        """Layout of a critic of z_oa."""
        inputs = self.features.state_action_size
        return Layout((inputs, *self.policy_layout.sizes[1:-1], 1))

    def _critics(
        self, names: Sequence[str], workspaces: Sequence[str], learned: bool = True
    ) -> list[Network]:
        """See `OffPolicyLearner._critics`; z_oa is computed once for all critics."""
        critics: list[Network] = []
        for name, workspace in zip(names, workspaces, strict=True):
            make = partial(FeatureCritic, self.features, critics[0] if critics else None)
            critics.append(self._network(name, self.critic_layout, workspace, learned, make))
        return critics


class DDPGOnFeatures(OnFeatures, DDPG):
    """DDPG on features learned with it."""

    losses = (*DDPG.losses, _LOSS)


class SACOnFeatures(OnFeatures, SAC):
    """SAC on features learned with it."""

    losses = (*SAC.losses, _LOSS)


class TD3OnFeatures(OnFeatures, TD3):
    """TD3 on features learned with it."""

    losses = (*TD3.losses, _LOSS)
