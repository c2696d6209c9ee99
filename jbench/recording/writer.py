"""The rows and the end of a recorded run, and environments that write rows."""

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from torch import nn

from jbench.agents.divergence import DivergedError, Divergence, divergent_loss
from jbench.cores import cores
from jbench.encoders import Encoder, on_observations
from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.policies.acting import Actor
from jbench.policies.copied import UnsupportedPolicyError, copy_module
from jbench.policies.network import SavedNetwork
from jbench.policies.saved import policy_files
from jbench.settings.records import ExternalSettings
from jbench.simulation.rollout import Act
from jbench.store import Record, schema
from jbench.training.evaluation import EvaluationSchedule, derive_seeds, evaluate_policy
from jbench.training.log import CommitTimer, ProcessorClock, RunLog

_COMMIT_EVERY = 15.0  # s

_COMPLETE = 0.99
"""Share of its control steps after which a run is complete. Gymnasium's vector environments spend
a step on each reset by default, so a loop of N steps makes up to N / 1001 control steps less."""


class RunWriter:
    """Writes a recorded run; the caller holds the lock of its record.

    Attributes:
        control_steps: made so far, over all environments.
    """

    def __init__(self, record: Record, settings: ExternalSettings, encoder: Encoder | None) -> None:
        """Starts the clocks of a run without rows."""
        self.control_steps = 0
        self._record, self._settings, self._encoder = record, settings, encoder
        self._log, self._clock = RunLog(record), ProcessorClock()
        self._pace, self._schedule = CommitTimer(_COMMIT_EVERY), EvaluationSchedule(settings)
        _, self._seed = derive_seeds(settings.seed)
        self._losses: dict[str, Any] = {}

    @property
    def is_complete(self) -> bool:
        """Whether the run has made its control steps."""
        return self.control_steps >= _COMPLETE * self._settings.steps

    def set_losses(self, values: Mapping[str, Any]) -> None:
        """Sets losses of the next episodes; tensors are read when an episode ends.

        Raises:
            RequestError: if the table `episodes` has no column of such a name.
        """
        if unknown := sorted(values.keys() - schema.LOSSES):
            raise RequestError(
                f"There is no loss {', '.join(unknown)}; there are {', '.join(schema.LOSSES)}, and "
                "log(NAME=VALUE) takes any other metric."
            )
        self._losses |= {
            name: value.detach() if hasattr(value, "detach") else value
            for name, value in values.items()
        }

    def check_action(self, action: Any) -> None:
        """Checks the action of the next control step.

        Raises:
            DivergedError: if it is not finite.
        """
        if not np.isfinite(np.asarray(action, np.float64)).all():
            raise DivergedError(Divergence(None, self.control_steps, "actions"))

    def episode(self, episode_return: float, length: int) -> None:
        """Adds a training episode that has just ended.

        Raises:
            RequestError: if a loss is not a number.
            DivergedError: if a loss is not finite.
        """
        numbers = _numbers(self._losses)
        if (name := divergent_loss(numbers)) is not None:
            raise DivergedError(Divergence(None, self.control_steps, name))
        self._clock.share([self._log])
        self._log.episode(self.control_steps, episode_return, length, numbers)
        if self._pace.is_due():
            self._pace.restart(self._log.commit())

    def metrics(self, values: Mapping[str, Any]) -> None:
        """Adds values that the loop logs.

        Raises:
            RequestError: if a value is not a number.
        """
        self._log.metrics(self.control_steps, _numbers(values))
        if self._pace.is_due():
            self._clock.share([self._log])
            self._pace.restart(self._log.commit())

    def evaluation_due(self) -> bool:
        """Returns whether a multiple of `evaluate_every` was passed since the last `True`."""
        return bool(self._settings.evaluate_episodes) and self._schedule.advance(self.control_steps)

    def evaluate(self, act: Act, control_steps: int) -> NDArray[np.float64]:
        """Runs the episodes of an evaluation side by side.

        Args:
            act: returns actions (n, action_size) for (encoded) observations (n, size).
            control_steps: after which the policy was copied.

        Returns:
            The returns (evaluate_episodes,).
        """
        act = on_observations(self._encoder, act)
        made = evaluate_policy(self._settings, self._seed, self._log.evaluations, act, cores())
        self._clock.share([self._log])
        self._log.evaluation(control_steps, made.episodes, made.path)
        return made.returns

    def finish(self, kept: tuple[SavedNetwork, int] | None) -> None:
        """Evaluates the kept policy unless it is older than the last evaluation; finishes the run.

        Evaluations that were due ran the caller's policy, whose copy may round differently.

        Args:
            kept: a policy, and the control steps after which it was copied.

        Raises:
            WorkError: if the run is not complete, or nothing can be written.
        """
        done, steps = self.control_steps, self._settings.steps
        if not self.is_complete:
            raise WorkError(
                f"The block has made {done:,} of {steps:,} control steps, so the run "
                f"{self._record.id} has failed; let it make all of them, or pass fewer steps."
            )
        evaluated = False
        if kept is not None and self._settings.evaluate_episodes:
            network, at = kept
            evaluated = self._schedule.last_steps <= at
            if evaluated:
                self.evaluate(network.act, at)
        self._clock.share([self._log])
        self._log.commit()
        policy = None if kept is None else kept[0]
        self._record.finish(self._log.summary(done, evaluated=evaluated), policy_files(policy))

    def stop(self, error: BaseException) -> None:
        """Commits the rows so far; marks the run as failed, unless Ctrl-C or an exit stopped it."""
        with contextlib.suppress(WorkError):
            self._clock.share([self._log])
            self._log.commit()
        if not isinstance(error, Exception):
            return
        details = error.divergence.to_summary() if isinstance(error, DivergedError) else {}
        with contextlib.suppress(WorkError):
            self._record.fail(sentence_of_failure(error), details)


def _numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Returns values as numbers.

    Raises:
        RequestError: if a value is not a number.
    """
    try:
        return {name: float(value) for name, value in values.items()}
    except (TypeError, ValueError) as error:
        raise RequestError(
            f"{', '.join(values)} must be numbers or tensors of one element ({error})."
        ) from None


class RecordedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose episodes are recorded.

    The first `reset` without a seed is seeded by the run. Rewards are those of the task, whatever
    the wrappers around this environment make of them.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], seed: int, running: Callable[[], RunWriter]
    ) -> None:
        """Wraps an environment whose `info` has the statistics of a finished episode.

        Args:
            running: returns the writer; refuses if this is not in the block of the recording.
        """
        super().__init__(env)
        self._seed: int | None = seed
        self._running = running

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        seed = self._seed if seed is None else seed
        self._seed = None
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment."""
        writer = self._running()
        writer.check_action(action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        writer.control_steps += 1
        # Removed, since a RecordEpisodeStatistics of the caller's own would refuse the key.
        episode = info.pop("episode", None)
        if episode is not None:
            writer.episode(float(episode["r"]), int(episode["l"]))
        return observation, reward, terminated, truncated, info


def copied_network(actor: Actor, inputs: int, outputs: int) -> SavedNetwork:
    """Returns a copy of a policy.

    Raises:
        UnsupportedPolicyError: if it is not a sequence of supported layers.
    """
    if isinstance(actor, nn.Module):
        return copy_module(actor, inputs, outputs)
    if hasattr(actor, "predict") and hasattr(actor, "policy"):
        from jbench.agents.sb3 import copy_model

        return copy_model(actor, inputs, outputs)
    raise UnsupportedPolicyError(f"a {type(actor).__name__} is not a torch module")
