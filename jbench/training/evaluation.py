"""The encoder, the environment and the evaluations that follow from the settings of a run."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from jbench.encoders import Encoder
from jbench.encoders.wrapper import EncodedObservation
from jbench.registration import environment_id, register_task
from jbench.settings.engines import ENGINES
from jbench.settings.evaluations import has_short_evaluations
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.tasks.find import find_task
from jbench.tasks.task import PATH_EVERY, Act, RobotPath, Task, episode_generator, rollout
from jbench.tasks.worlds import EpisodeError, Worlds

FINAL_EPISODES = 100
"""Episodes of the last evaluation, by which runs are compared. Ten are enough for a curve, but not
for a comparison: the returns of one agent's episodes vary more than the means of agents do."""


def make_env(
    settings: RunSettings | ExternalSettings, encoder: Encoder | None, robot: int = 0
) -> gymnasium.Env[Any, Any]:
    """Returns an environment with the wrappers of a run, and its robot with the given index."""
    options = {}
    if settings.augment is not None:
        options["augment"] = settings.augment + robot

    register_task(settings.task)
    env: gymnasium.Env[Any, Any] = gymnasium.make(
        environment_id(settings.task, augmented="augment" in options),
        max_episode_steps=settings.episode_steps,
        disable_env_checker=True,
        **options,
    )
    env = gymnasium.wrappers.RecordEpisodeStatistics(env, buffer_length=1)
    if settings.time_limit == "terminal":
        env = TerminalTimeLimit(env)
    if encoder is not None:
        env = EncodedObservation(env, encoder)
    return env


class TerminalTimeLimit(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Treats the time limit as terminal, without bootstrapping, as the paper's agents did."""

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment; a truncation becomes a termination."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated or truncated, False, info


def final_evaluation_episodes(settings: RunSettings, requested: int | None) -> int:
    """Returns the number of episodes of the last evaluation of a run.

    If none is requested, it is `FINAL_EPISODES`, but not more than the run has training episodes,
    and not fewer than in its other evaluations. In a short run whose user typed no evaluations, it
    is half of the training episodes.
    """
    if not settings.evaluate_episodes:
        return 0
    if requested is not None:
        return requested
    trained = settings.steps // settings.episode_steps
    if has_short_evaluations(
        settings.steps,
        settings.episode_steps,
        settings.evaluate_every,
        settings.evaluate_episodes,
    ):
        trained //= 2
    return max(settings.evaluate_episodes, min(FINAL_EPISODES, trained))


class RunSeeds(NamedTuple):
    """The seed of a run's agent, and that of its evaluations."""

    agent: int
    evaluations: int


def derive_seeds(seed: int) -> RunSeeds:
    """Returns the seeds that follow from that of a run."""
    agent, evaluations = np.random.SeedSequence(seed).generate_state(2)
    return RunSeeds(int(agent), int(evaluations))


class Evaluation(NamedTuple):
    """The episodes of a policy.

    Attributes:
        returns: (episodes,)
        lengths: (episodes,) control steps.
        path: the robot's in the first one, if there is one.
        failure: error of the first episode that could not go on.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    path: RobotPath | None
    failure: EpisodeError | None = None


def evaluate_policies(
    settings: RunSettings | ExternalSettings,
    seeds: Sequence[int],
    number: int,
    act: Act,
    *,
    threads: int = 1,
    control_steps: int = 0,
    episodes: int | None = None,
    show_done: Callable[[int], None] | None = None,
) -> list[Evaluation]:
    """Evaluates the deterministic policies of runs that differ in their seeds.

    The episodes of all runs are side by side, and each evaluation of a run has its own generator.
    An evaluation of more episodes begins in the initial states of one with fewer; its returns are
    equal up to rounding, since a matrix product rounds by how many episodes are side by side. With
    stable-baselines3, a run has one generator, and its episodes follow one another.

    Args:
        seeds: of the evaluations of each run.
        number: of the evaluation.
        act: returns actions (..., action_size) for observations (..., dim(O)) of the task, in the
            order of the runs.
        threads: of the simulation; the returns do not depend on them.
        control_steps: of the training so far; they determine the robot.
        episodes: of each run; None for the number in the settings, as in all earlier evaluations.
        show_done: is called with the number of episodes of each run that have ended.
    """
    # As many at a time as in other evaluations: a matrix product rounds by its size.
    block = settings.evaluate_episodes
    if not block:
        return [Evaluation(np.zeros(0), np.zeros(0, np.int64), None) for _ in seeds]

    if episodes is None:
        episodes = block

    generators = [episode_generator(seed, number) for seed in seeds]
    task = find_task(settings.task)
    augment = settings.augment
    if isinstance(settings, RunSettings):
        augment = settings.robot_seed(settings.robot_at(control_steps))

    if ENGINES[settings.engine].has_one_stream:
        block = 1
        (seed,) = seeds
        generators = [_generator_after(task, seed, number * settings.evaluate_episodes)]
        act = partial(_act_alone, act)

    blocks = []
    for done in range(0, episodes, block):
        count = min(block, episodes - done)
        with task.worlds(count * len(seeds), threads, augment) as worlds:
            blocks.append(_evaluations(task, worlds, generators, count, act))
        if show_done is not None:
            show_done(done + count)

    evaluations = []
    for parts in zip(*blocks, strict=True):
        returns = np.concatenate([part.returns for part in parts])
        lengths = np.concatenate([part.lengths for part in parts])
        failures = (part.failure for part in parts if part.failure is not None)
        failure = next(failures, None)
        evaluations.append(Evaluation(returns, lengths, parts[0].path, failure))

    return evaluations


def _generator_after(task: Task, seed: int, episodes: int) -> np.random.Generator:
    """Returns the only generator of a run after a number of evaluation episodes.

    Each has drawn its initial state, and before the first one, a state was drawn as well.
    """
    generator = np.random.default_rng(seed)
    with task.worlds(1) as worlds:
        for _ in range(1 + episodes):
            worlds.reset([generator])

    return generator


def _act_alone(act: Act, observations: NDArray[Any]) -> NDArray[Any]:
    """Returns the action (1, action_size) for an observation (1, dim(O)) of a single robot.

    The policy gets a vector, since it may round by shape.
    """
    return act(observations[0])[None]


def _evaluations(
    task: Task,
    worlds: Worlds,
    generators: Sequence[np.random.Generator],
    episodes: int,
    act: Act,
) -> list[Evaluation]:
    """Returns one evaluation for each generator, of episodes that are simulated side by side."""
    total = np.zeros(len(generators) * episodes)
    of_each_world = []
    for generator in generators:
        of_each_world += [generator] * episodes

    seen = worlds.reset(of_each_world)
    points = [worlds.points()]
    for step, transition in enumerate(rollout(worlds, seen, act), 1):
        total += transition.rewards
        if step % PATH_EVERY == 0:
            points.append(worlds.points())

    targets = worlds.targets()
    lengths = np.broadcast_to(worlds.lengths(), len(total))
    evaluations = []
    for first in range(0, len(total), episodes):
        path = None
        of_first_robot = [point[first] for point in points if point is not None]
        if of_first_robot:
            target = {name: float(targets[name][first]) for name in task.drawn}
            path = RobotPath(np.stack(of_first_robot), target)

        end = first + episodes
        failures = (error for world, error in worlds.failures.items() if first <= world < end)
        failure = next(failures, None)
        evaluations.append(Evaluation(total[first:end], lengths[first:end], path, failure))

    return evaluations
