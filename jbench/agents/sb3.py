"""The four algorithms of stable-baselines3, built from our settings, and policies of its models."""

from typing import Any

import numpy as np
import torch
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import (
    ActionNoise,
    NormalActionNoise,
    OrnsteinUhlenbeckActionNoise,
)
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from jbench.policies.acting import normalization
from jbench.policies.copied import UnsupportedPolicyError, copy_module
from jbench.policies.network import SavedLayer, SavedNetwork, linear_layer, relu_layers
from jbench.settings.algorithms import AlgorithmSettings, OffPolicySettings

CLASSES: dict[str, type[BaseAlgorithm]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}
"""The class of each algorithm."""

# Our settings that are not arguments of the same name of the classes.
_OURS = {
    "hidden_layers",
    "n_envs",
    "uniform_warmup",
    "action_noise",
    "noise_mean",
    "noise_sigma",
    "noise_theta",
    "noise_dt",
}

_LOSSES = {
    "actor_loss": "train/actor_loss",
    "critic_loss": "train/critic_loss",
    "entropy_coefficient": "train/ent_coef",
    "policy_loss": "train/policy_gradient_loss",
    "value_loss": "train/value_loss",
    "entropy_loss": "train/entropy_loss",
}


class _DDPGWithPolicyWarmup(DDPG):
    """DDPG that acts by its policy, not uniformly, before learning starts."""

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        return super()._sample_action(0, action_noise, n_envs)


def build(algo: str, settings: AlgorithmSettings, env: VecEnv, seed: int) -> BaseAlgorithm:
    """Returns an untrained agent on the CPU.

    Args:
        seed: of weights, noise, minibatches and environments, in [0, 2^32).
    """
    # Divergence is detected by actions and losses. Torch's validation would raise its own error in
    # the middle of an update.
    torch.distributions.Distribution.set_default_validate_args(False)
    layers = list(settings.hidden_layers)
    critic = "vf" if algo == "ppo" else "qf"
    arguments: dict[str, Any] = settings.model_dump(exclude=_OURS)
    kind = CLASSES[algo]
    if isinstance(settings, OffPolicySettings):
        arguments["action_noise"] = _noise(settings, env.action_space.shape)
        if algo == "ddpg" and not settings.uniform_warmup:
            kind = _DDPGWithPolicyWarmup
    agent = kind(
        "MlpPolicy",
        env,
        policy_kwargs={"net_arch": {"pi": layers, critic: layers}, "activation_fn": nn.ReLU},
        seed=seed,
        device="cpu",
        **arguments,
    )
    # No output to the terminal; the losses are read from the logger.
    agent.set_logger(Logger(folder=None, output_formats=[]))
    return agent


def losses(agent: BaseAlgorithm) -> dict[str, float]:
    """Returns the last losses by database name; empty before the first update."""
    values = agent.logger.name_to_value
    return {name: float(values[key]) for name, key in _LOSSES.items() if key in values}


def policy(agent: BaseAlgorithm) -> SavedNetwork:
    """Returns a copy of the agent's deterministic policy."""
    linear = [
        linear_layer(*(array.detach().numpy().copy() for array in (module.weight, module.bias)))
        for module in actor_module(agent.policy).modules()
        if isinstance(module, nn.Linear)
    ]
    return SavedNetwork(relu_layers(linear, "clip" if isinstance(agent, PPO) else "tanh"))


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
    network = copy_module(actor_module(policy), inputs, outputs)
    return SavedNetwork([*_normalization_layers(model), *network.layers])


def actor_module(policy: Any) -> nn.Module:
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


def _noise(settings: OffPolicySettings, shape: Any) -> ActionNoise | None:
    mean, sigma = np.full(shape, settings.noise_mean), np.full(shape, settings.noise_sigma)
    if settings.action_noise == "normal":
        return NormalActionNoise(mean, sigma)
    if settings.action_noise == "ornstein-uhlenbeck":
        return OrnsteinUhlenbeckActionNoise(
            mean, sigma, theta=settings.noise_theta, dt=settings.noise_dt
        )
    return None
