"""The off-policy rules on features that are learned with the agent.

An agent's rule stays what it is: its minibatch is rewritten so that z_o takes the place of the
observations, and its critics see z_oa (`features.FeatureCritic`).
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from torch import Generator, Tensor

from jbench.agents.batched.batch import Batch
from jbench.agents.batched.ddpg import DDPG
from jbench.agents.batched.features import FeatureCritic, Features
from jbench.agents.batched.learner import OffPolicyLearner
from jbench.agents.batched.network import Network
from jbench.agents.batched.sac import SAC
from jbench.agents.batched.td3 import TD3
from jbench.agents.batched.tensors import Part
from jbench.policies.feature_map import FeatureMap
from jbench.settings.ofe import OFESettings

_LOSS = "prediction_loss"


class OnFeatures(OffPolicyLearner):
    """What makes the features of an update rule, and lets the rule see these.

    Target networks see the newest features, as the others do; no gradient of the agent changes
    them. They are computed in full precision.
    """

    def __init__(
        self,
        settings: Any,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
        *,
        ofe: OFESettings,
    ) -> None:
        """As for any learner.

        Args:
            settings: of the algorithm.
            observation_size: numbers in an observation.
            part: whose numbers.
            low_precision: whether hidden layers of actor and critics are multiplied in bfloat16.
            ofe: settings of the features.
        """
        self.features = Features(ofe, observation_size, part)
        self._pretraining = ofe.pretraining
        self._batches: tuple[Batch, Batch] | None = None
        super().__init__(settings, self.features.size, part, low_precision)

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed."""
        super().initialize(generator)
        self.features.initialize(generator)

    def act(self, observations: Tensor) -> Tensor:
        """As `Learner.act`."""
        return super().act(self._seen(observations))

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """As `OffPolicyLearner.explore`."""
        if not self.random_policy:
            return self.act(observations)
        return super().explore(self._seen(observations), noise)

    def feature_map(self) -> FeatureMap:
        """As `Learner.feature_map`."""
        return self.features.to_map()

    def pretraining(self, control_steps: int) -> int:
        """As `OffPolicyLearner.pretraining`."""
        return round(self._pretraining * control_steps)

    def pretrain(self, batch: Batch) -> None:
        """As `OffPolicyLearner.pretrain`."""
        self.features.learn(batch)

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Learns features from a minibatch of observations, then the agent from their features."""
        self._record_loss(_LOSS, self.features.learn(batch))
        super().update(self._on_features(batch), delayed)

    def _seen(self, observations: Tensor) -> Tensor:
        out = self.part.scratch("seen", observations.shape[-2], self.features.size)
        return self.features.of_observations(observations, out)

    def _on_features(self, batch: Batch) -> Batch:
        """Returns a minibatch with features in the place of observations, the rest being shared."""
        if self._batches is None or self._batches[0] is not batch:
            shape = batch.rows.shape[-2], self.features.size + 2
            rows, next_rows = (self.part.scratch(f"{n} on features", *shape) for n in ("s", "s'"))
            self._batches = batch, Batch(rows, next_rows, batch.discounts, batch.noise)
        _, found = self._batches
        found.rows[..., -2:].copy_(batch.rows[..., -2:])
        self.features.of_observations(batch.observations, found.observations)
        self.features.of_observations(batch.next_observations, found.next_observations)
        return found

    def _critics(
        self, names: Sequence[str], workspaces: Sequence[str], learned: bool = True, joins: int = 0
    ) -> list[Network]:
        """As `OffPolicyLearner._critics`; z_oa is computed once for all of them."""
        sizes = (self.features.pair_size, *self.value_sizes[1:])
        critics: list[Network] = []
        for name, workspace in zip(names, workspaces, strict=True):
            make = partial(FeatureCritic, self.features, critics[0] if critics else None)
            critics.append(self._network(name, sizes, workspace, learned, make=make))
        return critics


class DDPGOnFeatures(OnFeatures, DDPG):
    """DDPG on features that are learned with it."""

    losses = (*DDPG.losses, _LOSS)


class SACOnFeatures(OnFeatures, SAC):
    """SAC on features that are learned with it."""

    losses = (*SAC.losses, _LOSS)


class TD3OnFeatures(OnFeatures, TD3):
    """TD3 on features that are learned with it."""

    losses = (*TD3.losses, _LOSS)
