"""Copies of the deterministic policies of stable-baselines3, and of classes with its interface."""

from typing import Any

import numpy as np
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from jbench.policies.actors import normalization
from jbench.policies.copied_modules import UnsupportedPolicyError, copy_module
from jbench.policies.layers import Clip, Scale, Shift
from jbench.policies.network import SavedNetwork


def copy_model(model: Any, sizes: tuple[int, int] | None = None) -> SavedNetwork:
    """Returns a copy of the deterministic policy of a model.

    Args:
        model: an algorithm of stable-baselines3, or of a class with its interface.
        sizes: of an observation and of an action; None for those of the spaces of the model.

    Raises:
        UnsupportedPolicyError: if it is not a sequence of supported layers, or has other sizes.
    """
    policy = model.policy
    if sizes is None:
        sizes = model.observation_space.shape[0], model.action_space.shape[0]
    owner = policy.actor if hasattr(policy, "actor") else policy
    if not isinstance(getattr(owner, "features_extractor", None), FlattenExtractor):
        raise UnsupportedPolicyError("its features extractor is not FlattenExtractor")

    network = copy_module(_actor_module(policy), *sizes)
    normalized: Any = normalization(model)
    if normalized is None:
        return network

    deviation = np.sqrt(normalized.obs_rms.var + normalized.epsilon)
    first = [
        Shift(offset=-normalized.obs_rms.mean.astype(np.float32)),
        Scale(factor=(1 / deviation).astype(np.float32)),
        Clip(low=-normalized.clip_obs, high=normalized.clip_obs),
    ]
    return SavedNetwork([*first, *network.layers])


def _actor_module(policy: Any) -> nn.Module:
    """Returns the layers of a model's policy from an observation to the deterministic action."""
    actor: Any = getattr(policy, "actor", None)
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return nn.Sequential(actor.latent_pi, actor.mu, nn.Tanh())
    if hasattr(actor, "mu"):  # DDPG, TD3
        return nn.Sequential(actor.mu)
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C, TRPO
        squash = nn.Tanh() if policy.squash_output else nn.Hardtanh()
        return nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net, squash)

    raise UnsupportedPolicyError(f"the actor of a {type(policy).__name__} is not known")
