"""Classes with the interface of stable-baselines3 by name, such as sb3_contrib:TQC."""

import inspect
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.type_aliases import TrainFrequencyUnit
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from torch import nn

from jbench import plugins
from jbench.agents.sb3 import copy_model
from jbench.errors import RequestError
from jbench.policies.copied import UnsupportedPolicyError
from jbench.settings.base import canonical_json

# Arguments that jbench gives, or that do not affect what is learned.
_NOT_SETTINGS = {
    *("self", "policy", "env", "seed", "device", "verbose", "tensorboard_log", "monitor_wrapper"),
    *("stats_window_size", "_init_setup_model", "support_multi_env", "supported_action_spaces"),
}


def find_class(name: str) -> type[BaseAlgorithm]:
    """Returns a class by its name, MODULE:CLASS.

    Raises:
        RequestError: if it does not exist, or is not an algorithm of stable-baselines3.
        WorkError: if its module raises an error.
    """
    kind = plugins.imported("algorithm", name)
    if not (isinstance(kind, type) and issubclass(kind, BaseAlgorithm)):
        raise RequestError(
            f"{name} is no subclass of jbench.Agent, jbench.Rule or stable-baselines3's "
            "BaseAlgorithm; record its training loop with jbench.record (docs/recording.md)."
        )
    return kind


def class_settings(name: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the settings of a class: the JSON values among its arguments.

    Args:
        name: MODULE:CLASS.
        overrides: values by name that replace the defaults.

    Raises:
        RequestError: if a setting is unknown, or the class refuses the values.
    """
    parameters = inspect.signature(find_class(name).__init__).parameters
    allowed = [
        name
        for name, parameter in parameters.items()
        if name not in _NOT_SETTINGS
        and not name.endswith("_class")
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    ]
    if unknown := sorted(set(overrides) - set(allowed)):
        raise RequestError(
            f"{name} has no setting {', '.join(unknown)}; it has {', '.join(sorted(allowed))}."
        )
    for setting, value in overrides.items():
        if not _is_json(value):
            raise RequestError(f"{setting} of {name} can't be {value!r}: numbers must be finite.")
    defaults = {n: parameters[n].default for n in allowed if _is_json(parameters[n].default)}
    values = {**defaults, **overrides}
    return {n: list(v) if isinstance(v, tuple) else v for n, v in values.items()}


def check(
    name: str,
    settings: Mapping[str, Any],
    observation_size: int,
    action_size: int,
    environments: int,
) -> None:
    """Builds an agent once, to see whether its class takes the settings.

    Raises:
        RequestError: if it does not, can't be trained in several environments, or its policy can't
            be saved.
    """
    env = DummyVecEnv([lambda: Spaces(observation_size, action_size)] * environments)
    try:
        agent = build(name, settings, env, seed=0)
    except Exception as error:
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
    if environments > 1 and unit is TrainFrequencyUnit.EPISODE:
        raise RequestError(
            f"train_freq of {name} can't be in episodes with {environments} environments: type a "
            "number of steps, or one environment."
        )
    try:
        copy_model(agent, observation_size, action_size)
    except UnsupportedPolicyError as error:
        raise RequestError(
            f"The policy of {name} can't be saved ({error.why}); record its training loop with "
            "jbench.record (docs/recording.md)."
        ) from None


def build(name: str, settings: Mapping[str, Any], env: VecEnv, seed: int) -> BaseAlgorithm:
    """Returns an untrained agent on the CPU, with the policy MlpPolicy.

    Args:
        name: MODULE:CLASS.
        settings: arguments as JSON values. A list is passed as a tuple, and the name of a module
            of torch.nn as the class, such as "ReLU" for activation_fn in policy_kwargs.
            action_noise is the standard deviation of normal noise.
        seed: in [0, 2^32).
    """
    arguments: dict[str, Any] = {
        n: tuple(v) if isinstance(v, list) else v for n, v in settings.items()
    }
    shape: Any = env.action_space.shape
    if isinstance(sigma := arguments.get("action_noise"), int | float):
        arguments["action_noise"] = NormalActionNoise(np.zeros(shape), np.full(shape, sigma))
    if isinstance(arguments.get("policy_kwargs"), Mapping):
        arguments["policy_kwargs"] = {
            n: getattr(nn, v) if n.endswith("_fn") and isinstance(v, str) else v
            for n, v in arguments["policy_kwargs"].items()
        }
    kind: Any = find_class(name)
    agent: BaseAlgorithm = kind("MlpPolicy", env, seed=seed, device="cpu", **arguments)
    # No output to the terminal; the losses are read from the logger.
    agent.set_logger(Logger(folder=None, output_formats=[]))
    return agent


def _is_json(value: Any) -> bool:
    try:
        canonical_json({"value": value})
    except (TypeError, ValueError):
        return False
    return True


class Spaces(gymnasium.Env[Any, Any]):
    """An environment of which only the spaces are used."""

    def __init__(self, observation_size: int, action_size: int) -> None:
        shape = (observation_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (action_size,), np.float32)
