"""A run on stable-baselines3, from its settings to its committed rows and trained policy."""

import contextlib
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from jbench.agents import sb3, sb3_classes
from jbench.agents.algorithms import algorithm_provenance
from jbench.agents.divergence import DivergedError, Divergence, divergent_loss
from jbench.encoders import Encoder
from jbench.errors import WorkError, sentence_of_failure
from jbench.policies.network import SavedNetwork
from jbench.policies.saved import policy_files
from jbench.settings.run import RunSettings
from jbench.simulation import find
from jbench.simulation.rollout import PATH_EVERY, Path, make_path, path_point
from jbench.store import Record, Results
from jbench.training.environment import RobotSequence, make_env, with_robot
from jbench.training.evaluation import EvaluationSchedule, derive_seeds, final_evaluation_episodes
from jbench.training.events import Event, Report, ignore
from jbench.training.log import CommitTimer, ProcessorClock, RunLog

_COMMIT_EVERY = 15.0  # s


def run(
    settings: RunSettings,
    results: Results,
    encoder: Encoder | None,
    report: Report = ignore,
    until: int | None = None,
    final_episodes: int | None = None,
) -> Record:
    """Trains and evaluates one agent, and saves the results.

    A finished run is returned unchanged; any other run starts over.

    Args:
        results: where the run is written.
        encoder: of the observations; None for the full observation.
        report: takes an event if the run starts again, and one after each training episode.
        until: control step at the end of an episode, where training stops and the run remains
            unfinished; None to finish it.
        final_episodes: see `jbench.training.evaluation.final_evaluation_episodes`.

    Raises:
        RequestError: if the task is not installed or has changed.
        WorkError: if another process is training this run, its agent diverges, or its results
            can't be written.
    """
    with results.locked("run", settings.id) as existing:
        if existing is not None and existing.status == "finished":
            return existing
        if existing is not None:
            report(Event("resumed", settings.id))
        find.check_specs(settings.task, settings.specs)
        made_on = {
            "device": "cpu",
            **algorithm_provenance(settings.algo),
            **find.code_provenance(settings.task),
        }
        record = results.create("run", settings.id, settings.values, made_on)
        try:
            _train(settings, record, encoder, report, until, final_episodes)
        except DivergedError as error:
            record.fail(str(error), error.divergence.to_summary())
            raise
        except Exception as error:
            with contextlib.suppress(WorkError):
                record.fail(sentence_of_failure(error))
            raise
    return record


def _train(
    settings: RunSettings,
    record: Record,
    encoder: Encoder | None,
    report: Report,
    until: int | None,
    final_episodes: int | None,
) -> None:
    log, clock = RunLog(record), ProcessorClock()
    agent_seed, evaluation_seed = derive_seeds(settings.seed)
    env = DummyVecEnv([lambda: RobotSequence(settings, encoder)] * settings.environments)
    agent = _build(settings, env, agent_seed)
    evaluator = SB3Evaluator(settings, encoder, evaluation_seed)
    evaluator.final_episodes = final_evaluation_episodes(settings, final_episodes)
    recorder = _Recorder(settings, log, clock, evaluator, report, until)
    try:
        agent.learn(settings.steps, recorder, log_interval=None)  # type: ignore[arg-type]
        recorder.check_agent()
    except DivergedError:
        clock.share([log])
        log.commit()
        raise
    if until is not None:
        log.commit()
        return
    if evaluator.last_steps < agent.num_timesteps:
        recorder.evaluate()
    log.commit()
    clock.share([log])
    summary = log.summary(agent.num_timesteps, evaluated=recorder.evaluated is not None)
    record.finish(summary, policy_files(recorder.evaluated or copy_policy(agent, settings)))


def _build(settings: RunSettings, env: VecEnv, seed: int) -> BaseAlgorithm:
    if settings.is_ours:
        return sb3.build(settings.algo, settings.algorithm, env, seed)
    return sb3_classes.build(settings.algo, settings.hyperparameters, env, seed)


def copy_policy(agent: BaseAlgorithm, settings: RunSettings) -> SavedNetwork:
    """Returns a copy of the agent's deterministic policy."""
    if settings.is_ours:
        return sb3.policy(agent)
    spaces: Any = agent.observation_space, agent.action_space
    return sb3.copy_model(agent, *(space.shape[0] for space in spaces))


class SB3Evaluator(EvaluationSchedule):
    """Evaluates a deterministic policy in a separate environment with its own seed.

    It uses the robot that the agent currently trains on.

    Attributes:
        final_episodes: number of episodes when all control steps are made.
    """

    def __init__(self, settings: RunSettings, encoder: Encoder | None, seed: int) -> None:
        super().__init__(settings)
        self._settings, self._encoder, self._robot = settings, encoder, 0
        self._episodes = self.final_episodes = settings.evaluate_episodes
        self._env = make_env(settings, encoder)
        self._env.reset(seed=seed)

    def skip(self, evaluations: int) -> None:
        """Draws the initial states of earlier evaluations, so that the next one is as recorded."""
        for _ in range(evaluations * self._episodes):
            self._env.reset()

    def __call__(
        self, act: Callable[[Any], Any], control_steps: int
    ) -> tuple[list[tuple[float, int]], Path | None]:
        """Returns return and length of each episode, and the Jitterbug's path in the first of them.

        Args:
            control_steps: control steps of training so far; they determine the robot.
        """
        robot = self._settings.robot_at(control_steps)
        if robot != self._robot:
            self._env = with_robot(self._env, self._settings, self._encoder, robot)
            self._robot = robot
        outcome, path = [], None
        robot_env: Any = self._env.unwrapped
        is_last = control_steps >= self._settings.steps
        for _ in range(self.final_episodes if is_last else self._episodes):
            observation, info = self._env.reset()
            ended, total, length = False, 0.0, 0
            follows = path is None and self._settings.specs is None
            points = [path_point(robot_env.state)] if follows else []
            while not ended:
                observation, reward, terminated, truncated, _ = self._env.step(act(observation))
                total, length, ended = total + float(reward), length + 1, terminated or truncated
                if follows and length % PATH_EVERY == 0:
                    points.append(path_point(robot_env.state))
            outcome.append((total, length))
            if follows:
                path = make_path(self._settings.task, points, info.get("target", np.zeros(0)))
        return outcome, path


class _Recorder(BaseCallback):
    """Logs each episode, evaluates the agent on schedule, and detects divergence.

    Attributes:
        evaluated: policy of the last evaluation; the last updates may come after it.
    """

    def __init__(
        self,
        settings: RunSettings,
        log: RunLog,
        clock: ProcessorClock,
        evaluator: SB3Evaluator,
        report: Report,
        until: int | None,
    ) -> None:
        super().__init__()
        self.evaluated: SavedNetwork | None = None
        self._settings, self._log, self._clock, self._until = settings, log, clock, until
        self._evaluator, self._report = evaluator, report
        self._timer = CommitTimer(_COMMIT_EVERY)

    def evaluate(self) -> None:
        """Evaluates the agent's current policy."""
        policy = copy_policy(self.model, self._settings)
        returns, path = self._evaluator(policy.act, self.num_timesteps)
        self._clock.share([self._log])
        self._log.evaluation(self.num_timesteps, returns, path)
        self.evaluated = policy if returns else None

    def check_agent(self) -> None:
        """Checks losses and weights after the last update.

        Raises:
            DivergedError: if one is not finite.
        """
        self._check_losses()
        for parameters in self.model.policy.parameters():
            self._check("weights", parameters.detach().numpy())

    def _check_losses(self) -> None:
        if (name := divergent_loss(sb3.losses(self.model))) is not None:
            self._fail(name)

    def _check(self, what: str, values: ArrayLike) -> None:
        if not np.isfinite(values).all():
            self._fail(what)

    def _fail(self, what: str) -> NoReturn:
        updates: int = self.model._n_updates
        raise DivergedError(Divergence(updates, self.num_timesteps, what))

    def _on_step(self) -> bool:
        self._check_losses()
        self._check("actions", self.locals["actions"])
        for info in self.locals["infos"]:
            if "episode" in info:
                statistics = info["episode"]
                episode_return, length = float(statistics["r"]), int(statistics["l"])
                self._check("episode_return", episode_return)
                self._clock.share([self._log])
                self._log.episode(
                    self.num_timesteps, episode_return, length, sb3.losses(self.model)
                )
                run, steps = self._settings.id, self.num_timesteps
                self._report(Event("episode", run, steps=steps, episode_return=episode_return))
                if self._timer.is_due():
                    self._timer.restart(self._log.commit())
        if self._evaluator.advance(self.num_timesteps):
            self.evaluate()
        return self._until is None or self.num_timesteps < self._until
