"""Agents of stable-baselines3: jbench's four algorithms, and classes with its interface by name."""

import inspect
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common import noise
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize
from torch import nn

from jbench.agents.find import find_class
from jbench.agents.memory import memory_error
from jbench.agents.sb3_policies import copy_model
from jbench.errors import ERRORS_OF_OTHERS, RequestError
from jbench.policies.copied_modules import UnsupportedPolicyError
from jbench.settings.algorithms import Algorithm, AlgorithmSettings, Foreign, OffPolicySettings
from jbench.store.schema import LOSSES

CLASSES: dict[str, type[BaseAlgorithm]] = {"ddpg": DDPG, "ppo": PPO, "sac": SAC, "td3": TD3}
"""The class of each of jbench's algorithms."""

_THEIR_NAMES = {"entropy_coefficient": "ent_coef", "policy_loss": "policy_gradient_loss"}
"""Names of losses in stable-baselines3's log that are not those of the database."""


class _PolicyWarmup(OffPolicyAlgorithm):
    """Acts by its policy, not uniformly, before learning starts."""

    def _sample_action(
        self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Samples by the policy and its noise from the first step on."""
        return super()._sample_action(0, action_noise, n_envs)


class _DDPGWithPolicyWarmup(_PolicyWarmup, DDPG):
    """DDPG whose first actions are its policy's."""


class _SACWithPolicyWarmup(_PolicyWarmup, SAC):
    """SAC whose first actions are drawn from its policy."""


class _TD3WithPolicyWarmup(_PolicyWarmup, TD3):
    """TD3 whose first actions are its policy's."""


_WITH_POLICY_WARMUP: dict[str, type[BaseAlgorithm]] = {
    "ddpg": _DDPGWithPolicyWarmup,
    "sac": _SACWithPolicyWarmup,
    "td3": _TD3WithPolicyWarmup,
}


def check(name: str, settings: Mapping[str, Any], sizes: tuple[int, int], count: int) -> None:
    """Builds an agent for some environments, to see whether its class takes the settings.

    Args:
        name: MODULE:CLASS.
        settings: arguments of the class as JSON values, see `build`.
        sizes: of an observation and of an action.
        count: number of environments.

    Raises:
        RequestError: if it does not, can't be trained in several environments, or its policy can't
            be saved.
    """
    env = DummyVecEnv([lambda: Spaces(*sizes)] * count)
    try:
        agent = build(name, Foreign(hyperparameters=dict(settings)), env, seed=0)
    except ERRORS_OF_OTHERS as error:
        reason = (str(error).splitlines() or [""])[0].rstrip(".")
        if "action spaces" in reason:  # the rest is the spaces' classes
            raise RequestError(
                f"{name} takes no continuous actions, which all tasks have; choose another class."
            ) from None

        raise RequestError(
            f"{name} can't be made with these settings ({type(error).__name__}: {reason})."
        ) from None

    # stable-baselines3 itself refuses this only when it collects the first transitions.
    unit = getattr(getattr(agent, "train_freq", None), "unit", None)
    if count > 1 and unit is TrainFrequencyUnit.EPISODE:
        raise RequestError(
            f"train_freq of {name} can't be in episodes with {count} environments: type a "
            "number of steps, or one environment."
        )

    try:
        copy_model(agent)
    except UnsupportedPolicyError as error:
        raise RequestError(
            f"The policy of {name} can't be saved ({error.why}); record its training loop with "
            "jbench.record (docs/recording.md)."
        ) from None


def build(algo: str, settings: Algorithm, env: VecEnv, seed: int) -> BaseAlgorithm:
    """Returns an untrained agent on the CPU, with the policy MlpPolicy.

    Args:
        algo: one of `CLASSES`, or MODULE:CLASS.
        settings: those of an algorithm of jbench; or arguments of the class as JSON values. A list
            is passed as a tuple, and the name of a module of torch.nn as the class, such as "ReLU"
            for activation_fn in policy_kwargs. action_noise is the standard deviation of normal
            noise.

    Raises:
        WorkError: if the replay buffer of an algorithm of jbench exceeds the memory.
    """
    shape: Any = env.action_space.shape
    chosen: Mapping[str, Any]
    kind: Any
    if isinstance(settings, AlgorithmSettings):
        kind = _own_class(algo, settings)
        chosen = _own_arguments(algo, settings, shape)
        env = _standardized(env, settings)
        # Divergence is detected by actions and losses. Torch's validation would raise its own error
        # in the middle of an update.
        torch.distributions.Distribution.set_default_validate_args(False)
    else:
        assert isinstance(settings, Foreign)
        kind = find_class(algo)
        chosen = settings.hyperparameters

    arguments = _arguments(chosen, shape)
    try:
        agent: BaseAlgorithm = kind("MlpPolicy", env, seed=seed, device="cpu", **arguments)
    except MemoryError as error:
        explained = memory_error(error, settings, seeds=1, memory="memory")
        if explained is None:
            raise
        raise explained from None

    # No output to the terminal; the losses are read from the logger.
    agent.set_logger(Logger(folder=None, output_formats=[]))
    return agent


def _arguments(chosen: Mapping[str, Any], shape: Any) -> dict[str, Any]:
    """Returns the arguments of a class for values that may be JSON, as `build` describes."""
    arguments: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in chosen.items()
    }
    sigma = arguments.get("action_noise")
    if isinstance(sigma, int | float):
        arguments["action_noise"] = noise.NormalActionNoise(np.zeros(shape), np.full(shape, sigma))

    if isinstance(arguments.get("policy_kwargs"), Mapping):
        arguments["policy_kwargs"] = {
            name: getattr(nn, value) if name.endswith("_fn") and isinstance(value, str) else value
            for name, value in arguments["policy_kwargs"].items()
        }

    return arguments


def _own_class(algo: str, settings: AlgorithmSettings) -> type[BaseAlgorithm]:
    """Returns the class of an algorithm of jbench's own."""
    if isinstance(settings, OffPolicySettings) and not settings.uniform_warmup:
        return _WITH_POLICY_WARMUP[algo]
    return CLASSES[algo]


def _own_arguments(algo: str, settings: AlgorithmSettings, shape: Any) -> dict[str, Any]:
    """Returns the settings of an algorithm of jbench's own as arguments of its class.

    Args:
        algo: its name.
        settings: its settings.
        shape: of an action.
    """
    taken = inspect.signature(CLASSES[algo]).parameters.keys()
    arguments = settings.model_dump(include=set(taken))
    critic = "vf"
    if isinstance(settings, OffPolicySettings):
        critic = "qf"
        arguments["action_noise"] = _own_noise(settings, shape)

    layers = list(settings.hidden_layers)
    arguments["policy_kwargs"] = {
        "net_arch": {"pi": layers, critic: layers},
        "activation_fn": "ReLU",
    }
    return arguments


def _own_noise(settings: OffPolicySettings, shape: Any) -> noise.ActionNoise | None:
    """Returns the action noise of an algorithm of jbench's own, if it has one."""
    mean = np.full(shape, settings.noise_mean)
    sigma = np.full(shape, settings.noise_sigma)
    if settings.action_noise == "normal":
        return noise.NormalActionNoise(mean, sigma)
    if settings.action_noise == "ornstein-uhlenbeck":
        return noise.OrnsteinUhlenbeckActionNoise(
            mean, sigma, theta=settings.noise_theta, dt=settings.noise_dt
        )
    return None


def _standardized(env: VecEnv, settings: AlgorithmSettings) -> VecEnv:
    """Returns an environment whose observations are standardized if the settings say so."""
    if settings.normalize == "none":
        return env
    return VecNormalize(
        env,
        norm_reward=False,
        clip_obs=settings.normalize_clip,
        epsilon=settings.normalize_epsilon,
    )


def rollout(agent: BaseAlgorithm) -> int:
    """Returns the control steps over all environments between learning phases; 1 if unknown.

    They are unknown if the agent counts episodes, which may end early.
    """
    count = agent.n_envs
    if isinstance(agent, OnPolicyAlgorithm):
        return agent.n_steps * count

    frequency = getattr(agent, "train_freq", None)
    if isinstance(frequency, TrainFreq) and frequency.unit is TrainFrequencyUnit.STEP:
        return frequency.frequency * count
    return 1


def losses(agent: BaseAlgorithm) -> dict[str, float]:
    """Returns the last losses by database name; empty before the first update."""
    values = agent.logger.name_to_value
    keys = {name: f"train/{_THEIR_NAMES.get(name, name)}" for name in LOSSES}
    return {name: float(values[key]) for name, key in keys.items() if key in values}


class Spaces(gymnasium.Env[Any, Any]):
    """An environment of which only the spaces are used."""

    def __init__(self, observation_size: int, action_size: int) -> None:
        """Has the spaces of an environment of these sizes, and never steps."""
        shape = (observation_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (action_size,), np.float32)
