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
from jbench.training.evaluation import final_evaluation_episodes

_STEPS, _UPDATES = 300, 40


def seconds_per_step(runs: Sequence[RunSettings], device: str = "cpu") -> float:
    """Returns the seconds per control step of each run of a process, evaluations included.

    The measurement uses temporary agents and does not affect the runs. Encoders are left out: their
    cost is negligible. Raises a WorkError if neither the algorithm nor the engine is jbench's own.
    """
    settings = runs[0]
    if not settings.is_ours and settings.engine != "batched":
        raise WorkError(f"The speed of {settings.algo} is not measured.")
    idle, algorithm = len(runs) * stepping(settings), hyperparameters(settings)
    if isinstance(algorithm, OffPolicySettings) and settings.last_step < algorithm.first_update:
        learning = idle  # it ends before it learns
    else:
        learning = _learning(runs, device)
    return learning + evaluation_steps(settings) * idle


def evaluation_steps(settings: RunSettings) -> float:
    """Returns the control steps in evaluations of a run per control step of its training."""
    evaluations = max(1, settings.steps // settings.evaluate_every) - 1
    episodes = evaluations * settings.evaluate_episodes + final_evaluation_episodes(settings, None)
    return episodes * EPISODE_STEPS / settings.steps


def _learning(runs: Sequence[RunSettings], device: str) -> float:
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
        changes = {"buffer_size": first + rollout, "learning_starts": algorithm.batch_size, **often}
    changed = {**runs[0].hyperparameters, **changes}
    measured = [run.model_copy(update={"hyperparameters": changed}) for run in runs]
    with make_trainer(measured, [None] * len(runs), device) as engine:
        before, began = 0, time.perf_counter()

        def after_step(_: object) -> bool:
            nonlocal before, began
            if before < first < engine.control_steps:  # the first updates have been made
                before, began = engine.control_steps, time.perf_counter()
            return True

        unmeasured = runs[0].environments if first else 0  # the step after the first updates
        engine.train(first + unmeasured + rollout, after_step)
        return (time.perf_counter() - began) / (engine.control_steps - before)


def _short_schedule(settings: OffPolicySettings, environments: int) -> dict[str, int]:
    """Returns a `train_freq` and `gradient_steps` of the same ratio, but shorter."""
    steps, updates = settings.schedule(environments)
    max_parts = max(1, updates // _UPDATES)
    parts = max(n for n in range(1, max_parts + 1) if steps % n == updates % n == 0)
    return {"train_freq": steps // parts * environments, "gradient_steps": updates // parts}


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
