"""Evaluations of batched runs, and the robots that they train on."""

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from jbench.agents.trainer import Trainer
from jbench.settings.external import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.simulation import Robots, rollout
from jbench.simulation.rollout import Act
from jbench.tasks import resets
from jbench.tasks.robots import load_model


def seeds_of(seed: int) -> tuple[int, int]:
    """Returns the seed of the agent and that of the evaluations of a run with this seed."""
    agent, evaluations = np.random.SeedSequence(seed).generate_state(2)
    return int(agent), int(evaluations)


def robot_model(settings: RunSettings | ExternalSettings, which: int) -> mujoco.MjModel:
    """Returns the model of the run's robot with the given index, clamped to the last robot."""
    augment = settings.augment
    return _model(None if augment is None else augment + min(which, settings.robots - 1))


@lru_cache(maxsize=2)
def _model(augment: int | None) -> mujoco.MjModel:
    return load_model(augment)


def evaluation_returns(
    settings: RunSettings | ExternalSettings, seed: int, number: int, act: Act, threads: int
) -> tuple[NDArray[np.float64], int]:
    """Runs the episodes of an evaluation of one policy side by side, on the run's first robot.

    Args:
        settings: settings of the run.
        seed: of the run's evaluations.
        number: of the evaluation; each has its own generator.
        act: returns actions (n, 1) for observations (n, dim(O)) of the task.
        threads: number of simulation threads; the returns do not depend on it.

    Returns:
        The returns (evaluate_episodes,), and the control steps of an episode.
    """
    episodes, length = settings.evaluate_episodes, 0
    generator = resets.episode_generator(seed, number)
    starts = resets.draw_starts(settings.task, [generator] * episodes)
    returns = np.zeros(episodes)
    with Robots(robot_model(settings, 0), episodes, threads) as robots:
        for transition in rollout(settings.task, robots, starts, act):
            returns += transition.rewards
            length += 1
    return returns, length


class EvaluationSchedule:
    """Decides when a run is evaluated.

    Attributes:
        last_steps: control steps at the last evaluation.
    """

    def __init__(self, settings: RunSettings | ExternalSettings) -> None:
        self._every, self.last_steps = settings.evaluate_every, 0

    def advance(self, control_steps: int) -> bool:
        """Returns whether an evaluation is due at these control steps, and counts it as made."""
        if control_steps // self._every == self.last_steps // self._every:
            return False
        self.last_steps = control_steps
        return True


class Evaluator(EvaluationSchedule):
    """Evaluates the deterministic policies of all runs of a batch in parallel episodes.

    It uses the robot that the agents currently train on, and as many threads as training.
    Evaluation k of a run has its own generator, independent of earlier evaluations.
    """

    def __init__(self, settings: RunSettings, seeds: Sequence[int]) -> None:
        super().__init__(settings)
        self._settings, self._seeds, self._done = settings, seeds, 0

    def restore(self, done: int, last_steps: int) -> None:
        """Resumes after `done` evaluations, the last of them at `last_steps` control steps."""
        self._done, self.last_steps = done, last_steps

    def __call__(self, engine: Trainer) -> NDArray[np.float64]:
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
