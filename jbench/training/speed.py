"""Speed of training on this machine, measured within seconds with a temporary agent."""

import time
from collections.abc import Sequence

import numpy as np

from jbench.agents.algorithms import hyperparameters
from jbench.errors import WorkError
from jbench.names import EPISODE_STEPS
from jbench.settings.algorithms import OffPolicySettings, PPOSettings
from jbench.settings.run import RunSettings
from jbench.simulation import find_task
from jbench.training.engines import make_trainer
from jbench.training.environment import make_env
from jbench.training.evaluation import final_evaluation_episodes

_STEPS, _UPDATES = 300, 20


def seconds_per_step(runs: Sequence[RunSettings], device: str = "cpu") -> float:
    """Returns the seconds per control step of each run, evaluations included.

    The measurement uses temporary agents and does not affect the runs. Encoders are left out: their
    cost is negligible.

    Args:
        runs: runs that share a process; their settings differ only in their seeds.

    Raises:
        WorkError: if neither the algorithm nor the engine is jbench's own.
    """
    settings = runs[0]
    if not settings.is_ours and settings.engine != "batched":
        raise WorkError(f"The speed of {settings.algo} is not measured.")
    idle, algorithm = len(runs) * stepping(settings), hyperparameters(settings)
    if isinstance(algorithm, OffPolicySettings) and settings.last_step < algorithm.first_update:
        learning = idle  # it ends before it learns
    else:
        learning = _batched(runs, device) if settings.engine == "batched" else _on_sb3(settings)
    return learning + evaluation_steps(settings) * idle


def evaluation_steps(settings: RunSettings) -> float:
    """Returns the control steps in evaluations of a run per control step of its training."""
    evaluations = max(1, settings.steps // settings.evaluate_every) - 1
    episodes = evaluations * settings.evaluate_episodes + final_evaluation_episodes(settings, None)
    return episodes * EPISODE_STEPS / settings.steps


def _batched(runs: Sequence[RunSettings], device: str) -> float:
    """Returns the seconds per control step of each seed, from a rollout and its updates."""
    algorithm, changes = hyperparameters(runs[0]), {}
    if isinstance(algorithm, PPOSettings):
        rollout = algorithm.n_steps * algorithm.n_envs
        first = 0 if device == "cpu" else rollout  # a GPU's first calls take longer
    else:
        assert isinstance(algorithm, OffPolicySettings)
        often = _short_schedule(algorithm, runs[0].environments)
        rollout = max(often["train_freq"], _UPDATES)
        first = algorithm.batch_size + rollout
        changes = {"buffer_size": _STEPS, "learning_starts": algorithm.batch_size, **often}
    changed = {**runs[0].hyperparameters, **changes}
    measured = [run.model_copy(update={"hyperparameters": changed}) for run in runs]
    with make_trainer(measured, [None] * len(runs), device) as engine:
        # Warm up until the first updates have been made.
        for _ in engine.learn(first):
            pass
        before, began = engine.control_steps, time.perf_counter()
        for _ in engine.learn(before + rollout):
            pass
        return (time.perf_counter() - began) / (engine.control_steps - before)


def _short_schedule(settings: OffPolicySettings, environments: int) -> dict[str, int]:
    """Returns a `train_freq` and `gradient_steps` of the same ratio, but shorter."""
    steps, updates = settings.schedule(environments)
    max_parts = max(1, updates // _UPDATES)
    parts = max(n for n in range(1, max_parts + 1) if steps % n == updates % n == 0)
    return {"train_freq": steps // parts * environments, "gradient_steps": updates // parts}


def _on_sb3(settings: RunSettings) -> float:
    """Returns the seconds per control step of one run on stable-baselines3."""
    # They take a second to import.
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
    from stable_baselines3.common.vec_env import DummyVecEnv

    from jbench.agents import sb3

    values = settings.hyperparameters
    env = DummyVecEnv([lambda: make_env(settings, None)] * settings.environments)
    if settings.algo == "ppo":
        rollout = values["n_steps"] * settings.environments
        agent = sb3.build(settings.algo, settings.algorithm, env, seed=0)
        began = time.perf_counter()
        agent.learn(rollout)
        return float((time.perf_counter() - began) / rollout)
    changes = {"buffer_size": max(_STEPS, values["batch_size"]), "learning_starts": 10 * _STEPS}
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
        agent.train(gradient_steps=2, batch_size=values["batch_size"])
        times.append((time.perf_counter() - began) / 2)
    return float(stepping + values["gradient_steps"] / values["train_freq"] * np.median(times))


def stepping(settings: RunSettings) -> float:
    """Returns the seconds per control step without training."""
    task = find_task(settings.task)
    actions = np.zeros((1, task.action_size), np.float32)
    with task.worlds(1, augment=settings.augment) as worlds:
        worlds.reset([np.random.default_rng(0)])
        began = time.perf_counter()
        for _ in range(_STEPS):
            worlds.step(actions)
        return (time.perf_counter() - began) / _STEPS
