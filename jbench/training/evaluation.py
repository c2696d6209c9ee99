"""Evaluations of batched runs, and the robots that they train on."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.agents.engine import Engine
from jbench.names import EPISODE_STEPS
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.simulation import Act, find_task, rollout
from jbench.simulation.rollout import PATH_EVERY, Path
from jbench.tasks import resets

FINAL_EPISODES = 100
"""Episodes of the last evaluation, with which runs are compared. Ten are enough for a curve, but
the returns of an agent's episodes vary more than the expected returns of agents."""


def final_evaluation_episodes(settings: RunSettings, requested: int | None) -> int:
    """Returns the number of episodes of the last evaluation of a run.

    Args:
        requested: None for `FINAL_EPISODES`, but not more than the run has training episodes, and
            not fewer than in its other evaluations.
    """
    if not settings.evaluate_episodes:
        return 0
    most = min(FINAL_EPISODES, settings.steps // EPISODE_STEPS)
    return max(settings.evaluate_episodes, most) if requested is None else requested


def derive_seeds(seed: int) -> tuple[int, int]:
    """Returns the seed of the agent and that of the evaluations of a run with this seed."""
    agent, evaluations = np.random.SeedSequence(seed).generate_state(2)
    return int(agent), int(evaluations)


class Evaluation(NamedTuple):
    """An evaluation of one policy.

    Attributes:
        returns: (episodes,) of its episodes.
        length: control steps of an episode.
        path: of the robot in the first episode; None without episodes, or if the task has none.
    """

    returns: NDArray[np.float64]
    length: int
    path: Path | None

    @property
    def episodes(self) -> list[tuple[float, int]]:
        """Return and length of each episode."""
        return [(value, self.length) for value in self.returns.tolist()]


def evaluate_policy(
    settings: RunSettings | ExternalSettings, seed: int, number: int, act: Act, threads: int
) -> Evaluation:
    """Runs the episodes of an evaluation of one policy side by side, on the run's first robot.

    Args:
        seed: of the run's evaluations.
        number: of the evaluation; each has its own generator.
        act: returns actions (n, action_size) for observations (n, dim(O)) of the task.
        threads: number of simulation threads; the returns do not depend on it.
    """
    episodes, generator = settings.evaluate_episodes, resets.episode_generator(seed, number)
    (evaluation,) = _evaluations(
        settings.task, settings.augment, [generator], episodes, act, threads
    )
    return evaluation


def _evaluations(
    task: str,
    augment: int | None,
    generators: Sequence[np.random.Generator],
    episodes: int,
    act: Act,
    threads: int,
) -> list[Evaluation]:
    """Runs an evaluation of some episodes for each generator, all side by side."""
    total, length = np.zeros(len(generators) * episodes), 0
    with find_task(task).worlds(len(total), threads, augment) as worlds:
        seen = worlds.reset([generator for generator in generators for _ in range(episodes)])
        points = [worlds.points()]
        for transition in rollout(worlds, seen, act):
            total += transition.rewards
            length += 1
            if length % PATH_EVERY == 0:
                points.append(worlds.points())
        targets = worlds.targets()
    evaluations = []
    for first in range(0, len(total), episodes):
        here = [point[first] for point in points if point is not None]
        target = {name: float(numbers[first]) for name, numbers in targets.items()}
        path = Path(np.stack(here), target) if here else None
        evaluations.append(Evaluation(total[first : first + episodes], length, path))
    return evaluations


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
    Evaluation k of a run has its own generator, independent of earlier evaluations. An evaluation
    of more episodes begins with those of one with fewer, bit for bit.
    """

    def __init__(self, settings: RunSettings, seeds: Sequence[int]) -> None:
        super().__init__(settings)
        self._settings, self._seeds, self._done = settings, seeds, 0

    def restore(self, done: int, last_steps: int) -> None:
        """Resumes after `done` evaluations, the last of them at `last_steps` control steps."""
        self._done, self.last_steps = done, last_steps

    def __call__(self, engine: Engine, episodes: int | None = None) -> list[Evaluation]:
        """Returns an evaluation of each run.

        Args:
            episodes: None for the number in the settings.
        """
        settings, seeds = self._settings, self._seeds
        # As many at a time as in other evaluations: a matrix product rounds by its size.
        block = settings.evaluate_episodes
        if not block:
            return [Evaluation(np.zeros(0), 0, None) for _ in seeds]
        episodes = block if episodes is None else episodes
        generators = [resets.episode_generator(seed, self._done) for seed in seeds]
        augment = settings.robot_seed(settings.robot_at(engine.control_steps))
        threads = engine.environments.threads

        def act(observations: NDArray[np.float32]) -> NDArray[np.floating]:
            actions = engine.act(observations.reshape(len(seeds), -1, observations.shape[-1]))
            return actions.reshape(len(observations), -1)

        blocks = [
            _evaluations(
                settings.task, augment, generators, min(block, episodes - done), act, threads
            )
            for done in range(0, episodes, block)
        ]
        self._done += 1
        return [
            parts[0]._replace(returns=np.concatenate([part.returns for part in parts]))
            for parts in zip(*blocks, strict=True)
        ]
