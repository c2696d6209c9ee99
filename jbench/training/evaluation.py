"""Evaluations of the runs of a batch, and the robots that they learn on."""

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.engine import Engine
from jbench.settings.run import RunSettings
from jbench.simulation import Robots, rollout
from jbench.tasks import resets
from jbench.tasks.robots import load_model


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
    return load_model(augment)


class Schedule:
    """When a run is evaluated.

    Attributes:
        last_steps: control steps at the last evaluation.
    """

    def __init__(self, settings: RunSettings) -> None:
        """Counts from the beginning."""
        self._settings, self.last_steps = settings, 0

    def due(self, control_steps: int) -> bool:
        """Returns whether `evaluate_every` control steps have passed, and restarts the count."""
        every = self._settings.evaluate_every
        if control_steps // every == self.last_steps // every:
            return False
        self.last_steps = control_steps
        return True


class Evaluator(Schedule):
    """Episodes of the deterministic policies of all runs of a batch, side by side.

    The robot is the one that the agents learn on at the time, and as many threads step the robots
    as in training. Evaluation number k of a run draws
    its episodes from a generator of its own, so that what came before does not matter.
    """

    def __init__(self, settings: RunSettings, seeds: Sequence[int]) -> None:
        """Remembers what to evaluate.

        Args:
            settings: of the runs.
            seeds: of their evaluations.
        """
        super().__init__(settings)
        self._seeds, self._done = seeds, 0

    def restore(self, done: int, last_steps: int) -> None:
        """Goes on after so many evaluations, the last one at some control step."""
        self._done, self.last_steps = done, last_steps

    def __call__(self, engine: Engine) -> NDArray[np.float64]:
        """Returns the returns (runs, evaluate_episodes) of an evaluation."""
        task, episodes = self._settings.task, self._settings.evaluate_episodes
        shape = (len(self._seeds), episodes)
        total = np.zeros(shape)
        if not episodes:
            return total
        generators = [resets.episode_generator(seed, self._done) for seed in self._seeds]
        starts = resets.draw_starts(task, [one for one in generators for _ in range(episodes)])

        def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
            return engine.act(observations.reshape(*shape, -1)).reshape(-1, 1)

        model = robot_model(self._settings, self._settings.robot_at(engine.control_steps))
        with Robots(model, total.size, engine.environments.threads) as robots:
            for transition in rollout(task, robots, starts, act):
                total += transition.rewards.reshape(shape)
        self._done += 1
        return total
