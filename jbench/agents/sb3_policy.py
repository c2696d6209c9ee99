"""The deterministic policy of a stable-baselines3 model, or of one of a library built on it."""

from typing import Any

import numpy as np
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from jbench.policies.acting import normalization
from jbench.policies.copied import UnsupportedPolicyError, copy_module
from jbench.policies.network import SavedLayer, SavedNetwork


def copy_model(model: Any, inputs: int, outputs: int) -> SavedNetwork:
    """Returns a copy of the deterministic policy of a model.

    Args:
        inputs: size of an (encoded) observation.
        outputs: size of an action.

    Raises:
        UnsupportedPolicyError: if it is not a sequence of supported layers, or for other sizes.
    """
    policy = model.policy
    owner = policy.actor if hasattr(policy, "actor") else policy
    if not isinstance(getattr(owner, "features_extractor", None), FlattenExtractor):
        raise UnsupportedPolicyError("its features extractor is not FlattenExtractor")
    network = copy_module(actor_of(policy), inputs, outputs)
    return SavedNetwork([*_normalization_layers(model), *network.layers])


def actor_of(policy: Any) -> nn.Module:
    """Returns the layers of a model's policy from an observation to the deterministic action.

    Raises:
        UnsupportedPolicyError: if the kind of the policy is not known.
    """
    actor: Any = getattr(policy, "actor", None)
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return nn.Sequential(actor.latent_pi, actor.mu, nn.Tanh())
    if hasattr(actor, "mu"):  # DDPG, TD3
        return nn.Sequential(actor.mu)
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C, TRPO
        squash = nn.Tanh() if policy.squash_output else nn.Hardtanh()
        return nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net, squash)
    raise UnsupportedPolicyError(f"the actor of a {type(policy).__name__} is not known")


def _normalization_layers(model: Any) -> list[SavedLayer]:
    found = normalization(model)
    if found is None:
        return []
    statistics: Any = found.obs_rms
    deviation = np.sqrt(statistics.var + found.epsilon)
    return [
        SavedLayer("shift", {"offset": -statistics.mean.astype(np.float32)}),
        SavedLayer("scale", {"factor": (1 / deviation).astype(np.float32)}),
        SavedLayer("clip", numbers={"low": -found.clip_obs, "high": found.clip_obs}),
    ]
