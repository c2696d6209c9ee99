"""A run whose training loop is the caller's."""

import contextlib
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from torch import nn

from jbench.encoders import load_run_encoder
from jbench.errors import RequestError, WorkError
from jbench.loggers.logger import Logger, copying_rows
from jbench.policies.actors import Actor, acting
from jbench.policies.copied_modules import UnsupportedPolicyError, copy_module
from jbench.recording.writer import KeptPolicy, RecordedEnvironment, RunWriter, as_numbers
from jbench.settings.records import ExternalSettings
from jbench.store import Results, schema
from jbench.tasks.find import find_task
from jbench.training.evaluation import make_env

if TYPE_CHECKING:
    from stable_baselines3.common.callbacks import BaseCallback


_ONE_PROCESS = "Environments of a recording run in its process: use SyncVectorEnv or DummyVecEnv."


class AlreadyFinishedError(WorkError):
    """The run is in the results already: `with jbench.record(...)` skips the rest of its block."""


class Recording:
    """A run that is being recorded; `with` begins and ends it.

    The block of a finished run is left at the first use of the recording, without an error. A
    block that raises leaves a failed run. A run that was killed, interrupted or failed starts over.

    Attributes:
        id: of the run.
        finished: whether the block has found the run finished, or has finished it.
    """

    def __init__(
        self,
        settings: ExternalSettings,
        results: Results,
        made_on: Mapping[str, str | None],
        logger: Logger | None = None,
    ) -> None:
        """Prepares a recording, which begins with its block."""
        self.id = settings.id
        self.finished = False
        self._settings = settings
        self._results = results
        self._made_on = made_on
        self._encoder = load_run_encoder(settings.encoder, results)
        self._task = find_task(settings.task)
        self._logger = logger
        self._process = os.getpid()
        self._writer: RunWriter | None = None
        self._environments = 0  # made in this block

    def __repr__(self) -> str:
        """The id of the run."""
        return f"<jbench.Recording of {self.id}>"

    @property
    def control_steps(self) -> int:
        """Control steps made so far in this block, over all environments."""
        if self._writer is None:
            return 0
        return self._writer.control_steps

    def __enter__(self) -> "Recording":
        """Locks the run and creates its record; raises a WorkError if that is impossible.

        Raises a RequestError within the block of the same recording.
        """
        if self._writer is not None:
            raise RequestError(
                f"The run {self.id} is being recorded already: leave its block before the next one."
            )

        self._context = self._block()
        self._context.__enter__()
        return self

    def __exit__(self, *raised: Any) -> bool:
        """Finishes the run; a WorkError if it has too few control steps, or can't be written."""
        return bool(self._context.__exit__(*raised))

    @contextlib.contextmanager
    def _block(self) -> Iterator[None]:
        """Holds the lock of the run, and finishes or fails it at the end of the block."""
        with contextlib.ExitStack() as stack:
            existing = stack.enter_context(self._results.locked("run", self.id))
            if self._logger is not None:
                _note(self._logger.where)
                stack.enter_context(copying_rows(self._results, {self.id}, self._logger, _note))
            if existing is not None and existing.is_finished:
                self.finished = True
                try:
                    yield
                except AlreadyFinishedError as skipped:
                    _note(str(skipped))

                return

            sentence = f"Recording the run {self.id} in {self._results.name}"
            if existing is not None:
                sentence += f", which is {existing.status} and starts over"

            _note(f"{sentence}.")
            record = self._results.create("run", self.id, self._settings.values, self._made_on)
            self._writer = RunWriter(record, self._settings, self._encoder)
            self._environments = 0
            try:
                with self._writer.block():
                    yield
            finally:
                made = self._writer.control_steps
                planned = self._settings.steps
                self._writer = None
                self.finished = record.is_finished
                if self.finished and made > planned:
                    _note(
                        f"The block made {made:,} control steps, but steps={planned}: pass the "
                        "number that it makes, by which runs are compared."
                    )

                if self.finished:
                    _note(f"Recorded the run {self.id} in {self._results.name}.")

    def env(self) -> gymnasium.Env[Any, Any]:
        """Returns an environment whose episodes are recorded; each call makes one.

        The first `reset` is seeded by the run, unless the caller gives a seed. Raises a
        RequestError in another process than that of the recording.
        """
        self._running()
        env = make_env(self._settings, self._encoder)
        seed = np.random.SeedSequence(self._settings.seed, spawn_key=(self._environments,))
        env.unwrapped.np_random, _ = np_random(int(seed.generate_state(1)[0]))
        self._environments += 1
        return RecordedEnvironment(env, self._running)

    def losses(self, **values: Any) -> None:
        """Sets the losses that are recorded with the next episodes.

        Args:
            values: numbers, or tensors of one element, which are read when an episode ends; by the
                names of the columns of the table `episodes`, such as critic_loss and actor_loss,
                or a RequestError.
        """
        losses = self._running().losses
        unknown = sorted(values.keys() - schema.LOSSES)
        if unknown:
            raise RequestError(
                f"There is no loss {', '.join(unknown)}; there are {', '.join(schema.LOSSES)}, and "
                "log(NAME=VALUE) takes any other metric."
            )
        for name, value in values.items():
            losses[name] = value.detach() if hasattr(value, "detach") else value

    def log(self, **metrics: Any) -> None:
        """Records metrics at the current control step, in the table `metrics`.

        Args:
            metrics: numbers, or tensors of one element, by any name; else a RequestError. Each
                becomes a row.
        """
        writer = self._running()
        writer.log.metrics(writer.control_steps, as_numbers(metrics))
        writer.commit_if_due()

    def evaluate(self, actor: Actor) -> NDArray[np.float64] | None:
        """Evaluates a policy if `evaluate_every` control steps have passed.

        Args:
            actor: deterministic: a torch module, a model or policy of stable-baselines3, or a
                function that returns actions (n, action_size) for (encoded) observations (n, size);
                a RequestError if they have another shape or are not finite.

        Returns:
            The returns (evaluate_episodes,), or None if no evaluation was due.
        """
        writer = self._running()
        every = self._settings.evaluate_every
        due = writer.log.is_evaluation_due(every, self.control_steps)
        if not due or not self._settings.evaluate_episodes:
            return None
        with acting(actor, self._task.action_size) as act:
            return writer.evaluate(act, self.control_steps)

    def keep_policy(self, actor: Actor) -> None:
        """Keeps a copy of a policy, which `jbench evaluate` can run; replaces the last.

        Args:
            actor: a torch module that applies its layers one after another, or a
                stable-baselines3 model; else an UnsupportedPolicyError, which is a RequestError.
        """
        writer = self._running()
        task = self._task
        encoder = self._encoder
        inputs = task.observation_size if encoder is None else encoder.latent_size
        if isinstance(actor, nn.Module):
            copied = copy_module(actor, inputs, task.action_size)
        elif hasattr(actor, "predict") and hasattr(actor, "policy"):
            from jbench.agents.sb3_policies import copy_model

            copied = copy_model(actor, (inputs, task.action_size))
        else:
            raise UnsupportedPolicyError(f"a {type(actor).__name__} is not a torch module")

        writer.kept = KeptPolicy(copied, writer.control_steps)

    def sb3_callback(self) -> "BaseCallback":
        """Returns a callback for `learn` of a model of stable-baselines3, or of sb3-contrib.

        It records the losses, evaluates the model when that is due, and keeps its policy.
        """
        # They take a second to import.
        from stable_baselines3.common.callbacks import BaseCallback

        from jbench.agents import sb3

        self._running()
        recording = self

        class RecordingCallback(BaseCallback):
            def _on_step(self) -> bool:
                recording.losses(**sb3.losses(self.model))
                recording.evaluate(self.model)
                return True

            def _on_training_end(self) -> None:
                try:
                    recording.keep_policy(self.model)
                except UnsupportedPolicyError as error:
                    warnings.warn(str(error), stacklevel=2)

        return RecordingCallback()

    def __getstate__(self) -> NoReturn:
        """Raises a TypeError: the lock of the run belongs to one process."""
        raise TypeError(_ONE_PROCESS)

    def _running(self) -> RunWriter:
        """Returns the writer, or says why nothing can be recorded now."""
        if self.finished:
            raise AlreadyFinishedError(f"The run {self.id} is already finished; it is skipped.")
        if os.getpid() != self._process:
            raise RequestError(_ONE_PROCESS)
        if self._writer is None:
            raise RequestError("A recording is used within its block: with jbench.record(...).")
        return self._writer


def _note(sentence: str) -> None:
    """Prints a sentence to standard error."""
    print(sentence, file=sys.stderr, flush=True)
