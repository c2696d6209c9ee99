"""How long a run will take on this machine, measured within seconds on a throw-away agent."""

import time

import numpy as np
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv

from jbench.agents import sb3
from jbench.encoders import Encoder
from jbench.experiments.run import make_env
from jbench.experiments.settings import RunSettings
from jbench.names import EPISODE_STEPS

_STEPS, _UPDATES = 300, 20


def seconds_per_step(settings: RunSettings, encoder: Encoder | None) -> float:
    """Returns the seconds that a control step of a run takes, updates and evaluations included.

    The agent that is measured is thrown away, and no generator of the run has been made yet, so
    that the measurement changes nothing of the run.
    """
    env = DummyVecEnv([lambda: make_env(settings, encoder)] * settings.environments)
    measure = _on_policy if settings.algo == "ppo" else _off_policy
    evaluation_steps = settings.evaluate_episodes * EPISODE_STEPS
    evaluations = max(1, settings.steps // settings.evaluate_every)
    share = evaluations * evaluation_steps / settings.steps
    return measure(settings, env) + share * _stepping(settings, encoder)


def _stepping(settings: RunSettings, encoder: Encoder | None) -> float:
    """Returns the seconds of a control step without any learning."""
    env = make_env(settings, encoder)
    env.reset(seed=0)
    action = np.zeros(1, np.float32)
    began = time.perf_counter()
    for _ in range(_STEPS):
        env.step(action)
    return float((time.perf_counter() - began) / _STEPS)


def _on_policy(settings: RunSettings, env: DummyVecEnv) -> float:
    """Returns the seconds of a control step, from one rollout and its updates."""
    rollout = settings.hyperparameters["n_steps"] * settings.environments
    agent = sb3.build(settings.algo, settings.algorithm, env, seed=0)
    began = time.perf_counter()
    agent.learn(rollout)
    return float((time.perf_counter() - began) / rollout)


def _off_policy(settings: RunSettings, env: DummyVecEnv) -> float:
    """Returns the seconds of a control step and its share of the updates."""
    batch_size = settings.hyperparameters["batch_size"]
    changes = {"buffer_size": max(_STEPS, batch_size), "learning_starts": 10 * _STEPS}
    patient = settings.algorithm.model_copy(update=changes)
    agent = sb3.build(settings.algo, patient, env, seed=0)
    assert isinstance(agent, OffPolicyAlgorithm)
    began = time.perf_counter()
    agent.learn(_STEPS)
    stepping = (time.perf_counter() - began) / _STEPS
    times = []
    for _ in range(_UPDATES):
        began = time.perf_counter()
        # Two at a time: TD3 updates its actor at every other one.
        agent.train(gradient_steps=2, batch_size=batch_size)
        times.append((time.perf_counter() - began) / 2)
    updates = settings.hyperparameters["gradient_steps"] / settings.hyperparameters["train_freq"]
    return float(stepping + updates * np.median(times))
