"""Speed of training on stable-baselines3, measured with a temporary agent."""

import time

import numpy as np
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.agents import sb3
from jbench.encoders import Encoder
from jbench.settings.run import RunSettings
from jbench.training.environment import make_env

_STEPS, _UPDATES = 300, 20


def seconds_per_step(settings: RunSettings, encoder: Encoder | None) -> float:
    """Returns the seconds per control step of one run, without evaluations."""
    env = DummyVecEnv([lambda: make_env(settings, encoder)] * settings.environments)
    return (_on_policy if settings.algo == "ppo" else _off_policy)(settings, env)


def _on_policy(settings: RunSettings, env: DummyVecEnv) -> float:
    """Returns the seconds per control step, from one rollout and its updates."""
    rollout = settings.hyperparameters["n_steps"] * settings.environments
    agent = sb3.build(settings.algo, settings.algorithm, env, seed=0)
    began = time.perf_counter()
    agent.learn(rollout)
    return float((time.perf_counter() - began) / rollout)


def _off_policy(settings: RunSettings, env: DummyVecEnv) -> float:
    """Returns the seconds per control step, including its share of the updates."""
    batch_size = settings.hyperparameters["batch_size"]
    changes = {"buffer_size": max(_STEPS, batch_size), "learning_starts": 10 * _STEPS}
    probe_settings = settings.algorithm.model_copy(update=changes)
    agent = sb3.build(settings.algo, probe_settings, env, seed=0)
    assert isinstance(agent, OffPolicyAlgorithm)
    began = time.perf_counter()
    agent.learn(_STEPS)
    stepping = (time.perf_counter() - began) / _STEPS
    times = []
    for _ in range(_UPDATES):
        began = time.perf_counter()
        # Two updates at a time, because TD3 updates its actor in every other one.
        agent.train(gradient_steps=2, batch_size=batch_size)
        times.append((time.perf_counter() - began) / 2)
    updates = settings.hyperparameters["gradient_steps"] / settings.hyperparameters["train_freq"]
    return float(stepping + updates * np.median(times))
