"""Models of stable-baselines3 and of libraries built on it, such as sb3-contrib."""

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from jbench.agents import sb3
from jbench.policies.network import Layer, Network
from jbench.recording.actors import normalization
from jbench.recording.networks import UnsupportedPolicyError, network_of

if TYPE_CHECKING:
    from jbench.recording.recorder import Recording


def network_of_model(model: Any, inputs: int) -> Network:
    """Returns a copy of the deterministic policy of a model.

    Raises:
        UnsupportedPolicyError: if it is not a sequence of supported layers.
    """
    policy = model.policy
    owner = policy.actor if hasattr(policy, "actor") else policy
    if not isinstance(getattr(owner, "features_extractor", None), FlattenExtractor):
        raise UnsupportedPolicyError("its features extractor is not FlattenExtractor")
    network = network_of(_actor(policy), inputs)
    return Network([*_normalization_layers(model), *network.layers])


def _actor(policy: Any) -> nn.Module:
    """Returns the layers from an observation to the deterministic action."""
    actor: Any = getattr(policy, "actor", None)
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return nn.Sequential(actor.latent_pi, actor.mu, nn.Tanh())
    if hasattr(actor, "mu"):  # DDPG, TD3
        return nn.Sequential(actor.mu)
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C, TRPO
        squash = nn.Tanh() if policy.squash_output else nn.Hardtanh()
        return nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net, squash)
    raise UnsupportedPolicyError(f"the actor of a {type(policy).__name__} is not known")


def _normalization_layers(model: Any) -> list[Layer]:
    found = normalization(model)
    if found is None:
        return []
    statistics: Any = found.obs_rms
    deviation = np.sqrt(statistics.var + found.epsilon)
    return [
        Layer("shift", {"offset": -statistics.mean.astype(np.float32)}),
        Layer("scale", {"factor": (1 / deviation).astype(np.float32)}),
        Layer("clip", numbers={"low": -found.clip_obs, "high": found.clip_obs}),
    ]


class RecordingCallback(BaseCallback):
    """Records the losses of a model, evaluates it when that is due, and keeps its policy."""

    def __init__(self, recording: "Recording") -> None:
        """Makes the callback of a recording."""
        super().__init__()
        self._recording = recording

    def _on_step(self) -> bool:
        model: BaseAlgorithm = self.model
        if losses := sb3.losses(model):
            self._recording.losses(**losses)
        self._recording.evaluate(model)
        return True

    def _on_training_end(self) -> None:
        try:
            self._recording.keep_policy(self.model)
        except UnsupportedPolicyError as error:
            warnings.warn(str(error), stacklevel=2)
