"""The rows and the end of a recorded run, and environments that write rows."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
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
from jbench.simulation import Act
from jbench.store import Record
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.log import CommitTimer, ProcessorClock, RunLog

_COMMIT_EVERY = 15.0  # s


_COMPLETE = 0.99
"""Share of its control steps after which a run is complete. Gymnasium's vector environments spend
a step on each reset by default, so a loop of N steps makes up to N / 1001 control steps less."""


class RunWriter:
    """Writes a recorded run; the caller holds the lock of its record.

    Attributes:
        control_steps: made so far, over all environments.
        log: of the run.
        losses: of the next episodes, by name; tensors are read when an episode ends.
        kept: the policy to save, and the control steps after which it was copied.
    """

    def __init__(self, record: Record, settings: ExternalSettings, encoder: Encoder | None) -> None:
        """Starts the clocks of a run without rows."""
        self.control_steps, self.log, self.losses = 0, RunLog(record), dict[str, Any]()
        self.kept: tuple[SavedNetwork, int] | None = None
        self._record, self._settings, self._encoder = record, settings, encoder
        self._clock, self._pace = ProcessorClock(), CommitTimer(_COMMIT_EVERY)

    @contextlib.contextmanager
    def block(self) -> Iterator[None]:
        """Finishes the run at the end of the block, or marks it as failed.

        Raises:
            WorkError: if the block has made too few control steps, or nothing can be written.
        """
        try:
            try:
                yield
            except UnsupportedPolicyError:
                # A policy that can't be kept does not spoil a training that is complete.
                if self._is_complete:
                    self._finish()
                raise
            self._finish()
        except BaseException as error:
            if self._record.status == "unfinished":
                self._stop(error)
            raise

    def check_action(self, action: Any) -> None:
        """Checks the action of the next control step.

        Raises:
            DivergedError: if it is not finite.
        """
        if not np.isfinite(np.asarray(action, np.float64)).all():
            raise DivergedError(Divergence(None, self.control_steps, "actions"))

    def episode(self, episode_return: float) -> None:
        """Adds a training episode that has just ended.

        Raises:
            RequestError: if a loss is not a number.
            DivergedError: if a loss is not finite.
        """
        losses = as_numbers(self.losses)
        if (name := divergent_loss(losses)) is not None:
            raise DivergedError(Divergence(None, self.control_steps, name))
        self._clock.share([self.log])
        self.log.episode(self.control_steps, episode_return, losses)
        self.commit_if_due()

    def evaluate(self, act: Act, control_steps: int) -> NDArray[np.float64]:
        """Evaluates a policy on (encoded) observations; returns (evaluate_episodes,) returns.

        Args:
            control_steps: after which the policy was copied.
        """
        act = on_observations(self._encoder, act)
        seeds, number = derive_seeds(self._settings.seed)[1:], self.log.progress.evaluations
        (made,) = evaluate_policies(self._settings, seeds, number, act, threads=cores())
        self._clock.share([self.log])
        self.log.evaluation(control_steps, made.returns, made.path)
        return made.returns

    def commit_if_due(self) -> None:
        """Commits the rows so far, if it is time to."""
        if self._pace.is_due():
            self._clock.share([self.log])
            self._pace.restart(self.log.commit())

    @property
    def _is_complete(self) -> bool:
        return self.control_steps >= _COMPLETE * self._settings.steps

    def _finish(self) -> None:
        """Evaluates the kept policy unless it is older than the last evaluation; finishes the run.

        Evaluations that were due ran the caller's policy, whose copy may round differently.
        """
        if not self._is_complete:
            raise WorkError(
                f"The block has made {self.control_steps:,} of {self._settings.steps:,} control "
                f"steps, so the run {self._record.id} has failed; let it make all of them, or pass "
                "fewer steps."
            )
        policy, copied_at = self.kept or (None, -1)
        evaluated = False
        if policy is not None and self._settings.evaluate_episodes:
            evaluated = self.log.progress.last_evaluation <= copied_at
            if evaluated:
                self.evaluate(policy.act, copied_at)
        self._clock.share([self.log])
        self.log.commit()
        summary = self.log.summary(self.control_steps, evaluated=evaluated)
        self._record.finish(summary, policy_files(policy))

    def _stop(self, error: BaseException) -> None:
        """Commits the rows so far; marks the run as failed, unless Ctrl-C or an exit stopped it."""
        with contextlib.suppress(WorkError):
            self._clock.share([self.log])
            self.log.commit()
        if not isinstance(error, Exception):
            return
        details = error.divergence.to_summary() if isinstance(error, DivergedError) else {}
        with contextlib.suppress(WorkError):
            self._record.fail(sentence_of_failure(error), details)


def as_numbers(values: Mapping[str, Any]) -> dict[str, float]:
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
            writer.episode(float(episode["r"]))
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
