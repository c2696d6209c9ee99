"""How long a control step of a run takes, measured with temporary agents."""

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.agents.algorithms import hyperparameters
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.engine import Engine
from jbench.cores import cores
from jbench.errors import WorkError
from jbench.settings.algorithms import AlgorithmSettings
from jbench.settings.algorithms.base import Measurement
from jbench.settings.engines import ENGINES
from jbench.settings.run import RunSettings
from jbench.tasks.find import find_task
from jbench.tasks.task import Act
from jbench.training.engines import make_engine
from jbench.training.evaluation import final_evaluation_episodes

_STEPS = 300
"""Control steps of a measurement of the speed without training."""

_UPDATES = 40
"""Updates of a measurement of the speed of training, over all seeds."""

_UNMEASURED = 2
"""Updates of features before a measurement, in which a GPU loads and records its kernels."""


def seconds_per_step(
    runs: Sequence[RunSettings],
    device: str = "cpu",
    clock: Callable[[], float] = time.perf_counter,
    final_episodes: int | None = None,
) -> float:
    """Returns the seconds per control step of each run of a process, evaluations included.

    The mean over a whole run: an agent of an off-policy algorithm costs less until its first
    update, just before which learned features have updates of their own. The measurement takes
    seconds, with temporary agents. Encoders are left out: their cost is negligible. The clock is
    `time.process_time` if other work on the machine is not to count; `final_episodes` are those of
    the last evaluation, if the user typed them.

    Raises a WorkError if neither the algorithm nor the engine is jbench's own.
    """
    settings = runs[0]
    algorithm = hyperparameters(runs[0])
    if not isinstance(algorithm, AlgorithmSettings):
        raise WorkError(f"The speed of {settings.algo} is not measured.")

    count = settings.environments
    evaluating = evaluation_steps(settings, final_episodes)
    idle = len(runs) * stepping(settings, len(runs) * count, device=device, clock=clock)
    if settings.last_step < settings.first_update:
        return (1 + evaluating) * idle  # it ends before it learns

    updates = max(1, _UPDATES // len(runs))
    short = algorithm.measurement(count, device, updates)
    measured = [_shortened(run, short) for run in runs]
    robots = len(runs) * max(1, settings.evaluate_episodes)
    if ENGINES[settings.engine].has_one_stream:
        robots = 1

    with make_engine(measured, [None] * len(runs), device) as engine:
        learning = _learning(engine, short, count, clock)
        pretraining = _pretraining(engine, settings, updates, clock)
        evaluated = len(runs) * stepping(settings, robots, engine.act, device=device, clock=clock)

    share = learning_share(settings)
    return share * learning + (1 - share) * idle + pretraining + evaluating * evaluated


def _shortened(run: RunSettings, short: Measurement) -> RunSettings:
    """Returns the settings of a run whose learning begins soon, without pretraining."""
    changes: dict[str, Any] = {"hyperparameters": {**run.hyperparameters, **short.changes}}
    if run.ofe is not None:
        changes["ofe"] = run.ofe.model_copy(update={"pretraining": 0.0})
    return run.model_copy(update=changes)


def _learning(
    engine: Engine, short: Measurement, environments: int, clock: Callable[[], float]
) -> float:
    """Returns the seconds of a control step of all runs of a new engine while it learns."""
    before = 0
    began = clock()

    def after_step(_: object) -> bool:
        nonlocal before, began
        if before < short.first < engine.control_steps:  # the first updates have been made
            before = engine.control_steps
            began = clock()
        # Whole rollouts, with the updates of each. If the first one is measured, its updates end
        # the training.
        return before == 0 or engine.control_steps < before + short.rollout

    unmeasured = environments if short.first else 0  # the step after the first updates
    engine.train(short.first + unmeasured + short.rollout, after_step)
    return (clock() - began) / (engine.control_steps - before)


def _pretraining(
    engine: Engine, settings: RunSettings, updates: int, clock: Callable[[], float]
) -> float:
    """Returns the seconds per control step of all runs that updates of features alone take.

    They are made before the first update of the agents; here, they are some `updates` after it.
    """
    if settings.ofe is None:
        return 0.0

    assert isinstance(engine, OffPolicyEngine)
    engine.pretrain(_UNMEASURED)
    engine.check_weights()  # waits for a GPU, as below
    began = clock()
    engine.pretrain(updates)
    engine.check_weights()
    seconds = (clock() - began) / updates
    return seconds * settings.ofe.pretraining * settings.first_update / settings.last_step


def learning_share(settings: RunSettings) -> float:
    """Returns the share of a run's control steps that updates follow, as often as later.

    The control steps of the phase that ends with the first update count as such: PPO, whose first
    update follows its first rollout, has 1.
    """
    before = max(0, settings.first_update - settings.rollout)
    return max(0, settings.last_step - before) / settings.last_step


def evaluation_steps(settings: RunSettings, final_episodes: int | None = None) -> float:
    """Returns the control steps in evaluations of a run per control step of its training.

    Their episodes count as whole ones; `final_episodes` are those of the last evaluation, if the
    user typed them.
    """
    evaluations = max(1, settings.steps // settings.evaluate_every) - 1
    episodes = evaluations * settings.evaluate_episodes
    episodes += final_evaluation_episodes(settings, final_episodes)
    return episodes * settings.episode_steps / settings.steps


def stepping(
    settings: RunSettings,
    robots: int,
    act: Act | None = None,
    *,
    device: str = "cpu",
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Returns the seconds per control step of one of several robots side by side.

    They do nothing without a policy `act`. On a GPU each thread has a robot: `robots` are then
    multiplied by a whole number, so that each seed of a policy still has the same number of them.
    """
    task = find_task(settings.task)
    threads = 1
    if device != "cpu" and ENGINES[settings.engine].is_for_gpu:
        threads = cores()
        robots *= math.ceil(threads / robots)

    steps = max(1, _STEPS // robots)
    actions: NDArray[np.floating] = np.zeros((robots, task.action_size), np.float32)
    with task.worlds(robots, threads, settings.augment) as worlds:
        observations = worlds.reset([np.random.default_rng(0)] * robots)
        began = clock()
        for _ in range(steps):
            if act is not None:
                actions = act(observations)
            observations, _rewards = worlds.step(actions)
            worlds.check()
            if worlds.are_over():
                observations = worlds.reset([np.random.default_rng(0)] * robots)
        return (clock() - began) / (steps * robots)
