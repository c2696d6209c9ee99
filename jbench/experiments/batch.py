"""Runs that differ in their seeds alone, side by side on the batched engine."""

import contextlib
from collections.abc import Callable, Sequence
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.make import make_engine
from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.experiments.log import RunLog
from jbench.experiments.settings import RunSettings
from jbench.names import EPISODE_STEPS
from jbench.simulation import Robots
from jbench.store import Record, Results
from jbench.tasks import features, resets
from jbench.tasks import model as robot

Progress = Callable[[RunSettings, int, float], None]
"""Told after each training episode: the run, its control steps so far, and the return."""


def run_batch(
    runs: Sequence[RunSettings],
    results: Results,
    encoder: Encoder | None,
    *,
    device: str = "auto",
    progress: Progress = lambda run, steps, episode_return: None,
) -> dict[str, str]:
    """Trains and evaluates an agent for each run, and keeps what came out.

    A run that is finished is left as it is; any other starts over.

    Args:
        runs: of settings that differ in their seeds alone.
        results: where they go.
        encoder: of their observations.
        device: to learn on: one of `jbench.names.DEVICES`.
        progress: told of each training episode.

    Returns:
        A sentence for each run that failed, by its id; one failure does not stop the others.

    Raises:
        RequestError: if the device is not there, or the settings can't be shared out.
        WorkError: if the results can't be written.
    """
    failures: dict[str, str] = {}
    with contextlib.ExitStack() as locks:
        begun = []
        for run in runs:
            try:
                locks.enter_context(Record(results, "run", run.id).lock())
            except WorkError as error:
                failures[run.id] = str(error)
                continue
            found = results.find("run", run.id)
            if found is None or found.status != "finished":
                record = results.create("run", run.id, run.model_dump(mode="json"))
                begun.append((run, record))
        if begun:
            try:
                failures |= _Batch(begun, encoder, device).train(progress)
            except Exception as error:
                for _, record in begun:
                    with contextlib.suppress(WorkError):
                        record.fail(f"{type(error).__name__}: {error}")
                raise
    return failures


class _Batch:
    """The runs of a batch while they go on."""

    def __init__(
        self, runs: Sequence[tuple[RunSettings, Record]], encoder: Encoder | None, device: str
    ) -> None:
        self._runs = [run for run, _ in runs]
        self._records = [record for _, record in runs]
        self._logs = [RunLog(record) for record in self._records]
        self._failures: dict[int, str] = {}
        self._settings = settings = self._runs[0]
        seeds = [np.random.SeedSequence(run.seed).generate_state(2) for run in self._runs]
        self._engine = engine_of(settings, [int(seed) for seed, _ in seeds], encoder, device)
        self._evaluator = Evaluator(settings, [int(seed) for _, seed in seeds])

    def train(self, progress: Progress) -> dict[str, str]:
        """Goes from the first step to the last evaluation; returns what failed by the run's id."""
        with self._engine as engine:
            for returns in engine.learn(self._settings.steps):
                if returns is not None:
                    self._note_episodes(returns, progress)
                if self._evaluator.due(engine.control_steps):
                    self._evaluate()
            if self._evaluator.last_steps < engine.control_steps:
                self._evaluate()
            for place in self._going_on():
                self._finish(place)
        return {self._runs[place].id: reason for place, reason in self._failures.items()}

    def _note_episodes(self, returns: NDArray[np.float64], progress: Progress) -> None:
        """Writes down the episodes (seeds, environments) that have just ended."""
        steps = self._engine.control_steps
        for place in self._going_on():
            if not np.isfinite(returns[place]).all():
                self._fail(place, f"an episode's return is {returns[place].tolist()}")
                continue
            losses = self._engine.losses(place)
            for episode_return in returns[place].tolist():
                self._logs[place].episode(steps, episode_return, EPISODE_STEPS, losses)
                progress(self._runs[place], steps, episode_return)

    def _evaluate(self) -> None:
        returns = self._evaluator(self._engine)
        for place in self._going_on():
            outcome = [(value, EPISODE_STEPS) for value in returns[place].tolist()]
            self._logs[place].evaluation(self._engine.control_steps, outcome)

    def _finish(self, place: int) -> None:
        log, record = self._logs[place], self._records[place]
        log.commit()
        summary = {"wall_time": log.wall_time(), "steps_done": self._engine.control_steps}
        record.finish(summary, self._engine.policy(place).to_files())

    def _fail(self, place: int, reason: str) -> None:
        """Gives one run up; the others go on."""
        self._logs[place].commit()
        self._records[place].fail(reason)
        self._failures[place] = reason

    def _going_on(self) -> list[int]:
        return [place for place in range(len(self._runs)) if place not in self._failures]


def engine_of(
    settings: RunSettings, seeds: Sequence[int], encoder: Encoder | None, device: str
) -> Engine:
    """Returns the engine of runs with these settings.

    Args:
        settings: of the runs; their seed does not matter.
        seeds: of the agents.
        encoder: of their observations.
        device: one of `jbench.names.DEVICES`.
    """
    return make_engine(
        settings.algo,
        settings.algorithm,
        settings.task,
        seeds,
        environments=settings.environments,
        time_limit=settings.time_limit,
        encoder=encoder,
        models=lambda episode: robot_model(settings, episode // settings.episodes_on_each),
        device=device,
        precision=settings.precision,
    )


def robot_model(settings: RunSettings, which: int) -> mujoco.MjModel:
    """Returns the robot of a run, or one of several, the last for what lies beyond.

    Args:
        settings: of the run.
        which: of its robots, counted from 0.
    """
    augment = settings.augment
    return _model(None if augment is None else augment + min(which, settings.robots - 1))


@lru_cache(maxsize=2)
def _model(augment: int | None) -> mujoco.MjModel:
    return robot.load(augment)


class Evaluator:
    """Episodes of the deterministic policies of all runs of a batch, side by side.

    The robot is the one that the agents learn on at the time. Evaluation number k of a run draws
    its episodes from a generator of its own, so that what came before does not matter.
    """

    def __init__(self, settings: RunSettings, seeds: Sequence[int]) -> None:
        """Remembers what to evaluate.

        Args:
            settings: of the runs.
            seeds: of their evaluations.
        """
        self._settings, self._seeds = settings, seeds
        self.last_steps = self._done = 0

    def due(self, control_steps: int) -> bool:
        """Returns whether `evaluate_every` control steps have passed; then they count anew."""
        every = self._settings.evaluate_every
        if control_steps // every == self.last_steps // every:
            return False
        self.last_steps = control_steps
        return True

    def __call__(self, engine: Engine) -> NDArray[np.float64]:
        """Returns the returns (runs, evaluate_episodes) of an evaluation."""
        task, episodes = self._settings.task, self._settings.evaluate_episodes
        shape = (len(self._seeds), episodes)
        total = np.zeros(shape)
        if not episodes:
            return total
        model = robot_model(self._settings, self._settings.robot_at(engine.control_steps))
        quaternions, target = self._beginnings()
        with Robots(model, total.size, threads=1) as robots:
            state = robots.reset(quaternions)
            for _ in range(EPISODE_STEPS):
                seen = np.asarray(features.observation(task, state, target), np.float32)
                actions = engine.act(seen.reshape(*shape, -1))
                state = robots.step(actions.reshape(-1))
                total += np.asarray(features.reward(task, state, target)).reshape(shape)
        self._done += 1
        return total

    def _beginnings(self) -> tuple[NDArray[np.float64], features.Target]:
        """Returns the poses (runs * episodes, 4) and targets of the next evaluation."""
        quaternions, targets = [], []
        for seed in self._seeds:
            random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(self._done,)))
            for _ in range(self._settings.evaluate_episodes):
                quaternions.append(resets.draw_quaternion(random))
                targets.append(resets.draw_target(self._settings.task, random))
        positions, yaws = (np.stack(part) for part in zip(*targets, strict=True))
        return np.stack(quaternions), features.Target(positions, yaws)
