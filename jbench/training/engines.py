"""What trains the agents of a batch of runs, jbench's engine or another loop, and its speed."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jbench.agents.algorithms import hyperparameters
from jbench.agents.batched.engine import BatchedEngine
from jbench.agents.batched.make import make_engine
from jbench.agents.ending_environments import environments_class
from jbench.agents.find import find_class
from jbench.agents.plugin_engine import PluginEngine
from jbench.agents.trainer import Trainer
from jbench.closing import closed_on_error
from jbench.cores import cores
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.policies.saved import TrainedAgent
from jbench.settings.algorithms import SETTINGS, AlgorithmSettings
from jbench.settings.algorithms.base import Measurement
from jbench.settings.engines import ENGINES
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.tasks.find import check_specs, find_task
from jbench.tasks.task import Act
from jbench.training.evaluation import derive_seeds, final_evaluation_episodes

_STEPS = 300
"""Control steps of a measurement of the speed without training."""

_UPDATES = 40
"""Updates of a measurement of the speed of training, over all seeds."""


def make_trainer(
    runs: Sequence[RunSettings], encoders: Sequence[Encoder | None], device: str
) -> Trainer:
    """Returns what trains an agent for each run, which may share a process; see `run_batch`.

    Raises a RequestError if the device is unavailable, the algorithm is not installed or can't be
    made, or the task is not installed or has changed; a WorkError if the package of the algorithm
    can't be imported, or its update rule can't be trained.
    """
    settings = runs[0]
    check_specs(settings.task, settings.specs, settings.accepted is not None)

    seeds = [derive_seeds(run.seed)[0] for run in runs]
    if settings.engine == "sb3":
        from jbench.training.sb3_engine import SB3Engine  # takes a second to import

        return SB3Engine(settings, encoders[0], seeds[0])

    algorithm: Any = settings.algo if settings.algo in SETTINGS else find_class(settings.algo)
    values: Any = hyperparameters(settings)
    train_on = find_device(device)
    environments = environments_class(settings.task)(
        settings.task,
        seeds,
        settings.environments,
        encoders,
        # On a CPU, learning dominates, and one process per core is faster.
        threads=cores() if train_on.type == "cuda" else 1,
        augment=lambda episode: settings.robot_seed(episode // settings.episodes_on_each),
        episode_steps=settings.episode_steps,
    )
    with closed_on_error(environments):
        if settings.engine == "plugin":
            return PluginEngine(
                settings.algo,
                algorithm,
                values,
                environments,
                time_limit=settings.time_limit,
                device=train_on,
            )

        return make_engine(
            algorithm,
            values,
            environments,
            time_limit=settings.time_limit,
            device=train_on,
            ofe=settings.ofe,
            precision=settings.precision,
        )


@contextmanager
def acting_as_evaluated(
    settings: RunSettings | ExternalSettings, agent: TrainedAgent, control_steps: int, device: str
) -> Iterator[Act]:
    """Yields the actions of a run's kept policy, with the bits that its last evaluation had.

    Raises a RequestError or a ValueError if the policy is not that of an agent with these settings.
    """
    if settings.engine != "batched":
        yield agent.act
        return
    assert isinstance(settings, RunSettings)
    # The products of the engine round differently from those of the copy.
    with make_trainer([settings], [agent.encoder], device) as engine:
        assert isinstance(engine, BatchedEngine)
        engine.load_policy(0, agent.policy, control_steps)
        yield engine.act


def seconds_per_step(
    runs: Sequence[RunSettings],
    device: str = "cpu",
    clock: Callable[[], float] = time.perf_counter,
    final_episodes: int | None = None,
) -> float:
    """Returns the seconds per control step of each run of a process, evaluations included.

    The mean over a whole run: an agent of an off-policy algorithm costs less until its first
    update. The measurement takes seconds, with temporary agents. Encoders are left out: their cost
    is negligible. The clock is `time.process_time` if other work on the machine is not to count;
    `final_episodes` are those of the last evaluation, if the user typed them.

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

    short = algorithm.measurement(count, device, max(1, _UPDATES // len(runs)))
    changed = {**settings.hyperparameters, **short.changes}
    measured = [run.model_copy(update={"hyperparameters": changed}) for run in runs]
    with make_trainer(measured, [None] * len(runs), device) as engine:
        learning = _learning(engine, short, count, clock)
        alone = ENGINES[settings.engine].has_one_stream
        robots = 1 if alone else len(runs) * max(1, settings.evaluate_episodes)
        evaluated = len(runs) * stepping(settings, robots, engine.act, device=device, clock=clock)

    share = learning_share(settings)
    return share * learning + (1 - share) * idle + evaluating * evaluated


def _learning(
    engine: Trainer, short: Measurement, environments: int, clock: Callable[[], float]
) -> float:
    """Returns the seconds per control step of each run of a new engine while it learns."""
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
