"""The rows and the end of a recorded run, and environments that write rows."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from jbench.agents.divergence import DivergedError, divergent_loss
from jbench.cores import cores
from jbench.encoders import Encoder, on_observations
from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.policies.copied_modules import UnsupportedPolicyError
from jbench.policies.network import SavedNetwork
from jbench.settings.records import ExternalSettings
from jbench.store import Record
from jbench.tasks.task import Act
from jbench.training.evaluation import derive_seeds, evaluate_policies
from jbench.training.log import CommitTimer, ProcessorClock, RunLog

_COMMIT_EVERY = 15.0  # s
_COMPLETE = 0.99
"""Share of its control steps after which a run is complete."""


class KeptPolicy(NamedTuple):
    """A copy of a policy, and the control steps of the run when it was copied."""

    policy: SavedNetwork
    control_steps: int


class RunWriter:
    """Writes a recorded run; the caller holds the lock of its record."""

    def __init__(self, record: Record, settings: ExternalSettings, encoder: Encoder | None) -> None:
        """Begins a run with no episode."""
        self.control_steps = 0  # over all environments
        self.log = RunLog(record)
        self.losses: dict[str, Any] = {}  # of the next episodes; read when one ends
        self.kept: KeptPolicy | None = None
        self._record = record
        self._settings = settings
        self._encoder = encoder
        self._processor_clock = ProcessorClock()
        self._commit_timer = CommitTimer(_COMMIT_EVERY)

    @contextlib.contextmanager
    def block(self) -> Iterator[None]:
        """Finishes the run at the end of the block; marks it as failed if it has too few steps."""
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

    def episode(self, episode_return: float, length: int) -> None:
        """Adds an ended training episode; a loss must be a finite number, else the run diverged."""
        losses = as_numbers(self.losses)
        name = divergent_loss(losses)
        if name is not None:
            raise DivergedError(None, self.control_steps, name)
        self._processor_clock.share([self.log])
        self.log.episode(self.control_steps, episode_return, losses, length)
        self.commit_if_due()

    def evaluate(self, act: Act, control_steps: int) -> NDArray[np.float64]:
        """Returns the (evaluate_episodes,) returns of a policy, copied at a control step."""
        act = on_observations(self._encoder, act)
        seeds = [derive_seeds(self._settings.seed).evaluations]
        number = self.log.progress.evaluations
        (made,) = evaluate_policies(self._settings, seeds, number, act, threads=cores())
        if made.failure is not None:
            raise made.failure

        self._processor_clock.share([self.log])
        self.log.evaluation(control_steps, made.returns.tolist(), made.lengths.tolist(), made.path)
        return made.returns

    def commit_if_due(self) -> None:
        """Commits the rows so far, at most every 15 s."""
        if self._commit_timer.is_due():
            self._processor_clock.share([self.log])
            with self._commit_timer.committing():
                self.log.commit()

    @property
    def _is_complete(self) -> bool:
        """Whether nearly all planned control steps were made.

        Gymnasium's vector environments spend a step of the loop on each reset by default.
        """
        made = self.control_steps + self.log.progress.episodes
        return made >= _COMPLETE * self._settings.steps

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

        evaluated = False
        files = dict[str, bytes]()
        if self.kept is not None:
            newest = self.log.progress.last_evaluation <= self.kept.control_steps
            evaluated = newest and self._settings.evaluate_episodes > 0
            files = self.kept.policy.files()
            if evaluated:
                self.evaluate(self.kept.policy.act, self.kept.control_steps)

        self._processor_clock.share([self.log])
        self.log.commit()
        self._record.finish(self.log.summary(self.control_steps, evaluated=evaluated), files)

    def _stop(self, error: BaseException) -> None:
        """Commits the rows so far; marks the run as failed, unless Ctrl-C or an exit stopped it."""
        with contextlib.suppress(WorkError):
            self._processor_clock.share([self.log])
            self.log.commit()
        if not isinstance(error, Exception):
            return

        details = {}
        if isinstance(error, DivergedError):
            details = error.summary
        with contextlib.suppress(WorkError):
            self._record.fail(sentence_of_failure(error), details)


def as_numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Returns values as numbers; raises a RequestError if one is none."""
    try:
        return {name: float(value) for name, value in values.items()}
    except (TypeError, ValueError, OverflowError) as error:
        raise RequestError(
            f"{', '.join(values)} must be numbers or tensors of one element ({error})."
        ) from None


def _is_not_finite(action: Any) -> bool:
    """Returns whether an action is numbers of which one is not finite; the task refuses others."""
    try:
        is_finite = action is None or np.isfinite(np.asarray(action, np.float64)).all()
    except (TypeError, ValueError):
        return False
    return not is_finite


class RecordedEnvironment(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose episodes are recorded.

    Rewards are those of the task, whatever the wrappers around this environment make of them.
    `running` returns the writer, or refuses outside of the block of the recording.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], running: Callable[[], RunWriter]) -> None:
        """Reports each episode of an environment to the run that is being recorded."""
        super().__init__(env)
        self._running = running
        self._has_ended = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode."""
        self._has_ended = False
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment.

        Raises:
            DivergedError: if the action is not finite.
            RequestError: if the episode has ended.
        """
        writer = self._running()
        if self._has_ended:
            raise RequestError(
                "The episode has ended: call reset before the next step, as terminated or "
                "truncated says."
            )

        if _is_not_finite(action):
            raise DivergedError(None, writer.control_steps, "actions")

        observation, reward, terminated, truncated, info = self.env.step(action)
        writer.control_steps += 1
        self._has_ended = bool(terminated or truncated)
        # Removed, since a RecordEpisodeStatistics of the caller's own would refuse the key.
        episode = info.pop("episode", None)
        if episode is not None:
            writer.episode(float(episode["r"]), int(episode["l"]))

        return observation, reward, terminated, truncated, info
