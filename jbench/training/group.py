"""Trains runs in one engine, and commits their rows and checkpoints."""

import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.divergence import DivergedError, Divergence
from jbench.errors import WorkError
from jbench.names import EPISODE_STEPS
from jbench.policies.network import SavedNetwork
from jbench.policies.saved import policy_files
from jbench.training.batch_member import Member
from jbench.training.checkpoints import newest, read_replay, save
from jbench.training.engines import make_trainer
from jbench.training.evaluation import Evaluator, derive_seeds, final_evaluation_episodes
from jbench.training.events import Event, Report
from jbench.training.log import CommitTimer, Position, ProcessorClock


class TrainingGroup:
    """Runs that are trained together, all at the same control step."""

    def __init__(
        self,
        members: Sequence[Member],
        device: str,
        checkpoint_every: float,
        sharing: int,
        final_episodes: int | None = None,
        *,
        keep_state: bool = False,
    ) -> None:
        """Makes the engine, and restores it from the checkpoints of the runs.

        Args:
            device: see `jbench.devices.find_device`.
            checkpoint_every: minimum seconds between two checkpoints.
            sharing: number of runs that share the process, those at other steps among them.
            final_episodes: see `jbench.training.evaluation.final_evaluation_episodes`.
            keep_state: whether the runs, when they finish, keep a checkpoint of their last step.
        """
        self._sharing = sharing
        self._members, self._timer = members, CommitTimer(checkpoint_every)
        self._keep_state = keep_state
        self._clock = ProcessorClock()
        self._failures: dict[int, WorkError] = {}
        # Of the last evaluation, by index.
        self._evaluated: dict[int, SavedNetwork | None] = {}
        self._settings = settings = members[0].settings
        self._final_episodes = final_evaluation_episodes(settings, final_episodes)
        self._engine = make_trainer(
            [m.settings for m in members], [m.encoder for m in members], device
        )
        self._evaluator = Evaluator(settings, [derive_seeds(m.settings.seed)[1] for m in members])
        if members[0].checkpoint is not None:
            self._restore(members[0].checkpoint.position)

    def train(self, until: int | None, report: Report) -> dict[str, WorkError]:
        """Trains to a control step (None: to the end), or until all runs have failed.

        Returns:
            The error of each failed run by id.
        """
        with self._engine as engine:
            for returns in engine.learn(self._settings.steps):
                self._fail_diverged()
                if not self._active():
                    break
                if returns is not None:
                    self._note_episodes(returns, report)
                if self._evaluator.advance(engine.control_steps):
                    self._evaluate()
                if engine.control_steps == until:
                    break
                if self._is_checkpoint_due(episode_ended=returns is not None):
                    self._save()
            if until is None:
                self._end()
            else:
                self._save()
        return {self._members[index].settings.id: e for index, e in self._failures.items()}

    def _is_checkpoint_due(self, *, episode_ended: bool) -> bool:
        if self._keep_state and self._engine.has_made(self._settings.steps):
            return True
        return episode_ended and self._timer.is_due()

    def _restore(self, position: Position) -> None:
        """Restores engine and evaluator from the checkpoints of the runs."""
        checkpoints = [m.checkpoint for m in self._members if m.checkpoint is not None]
        for index, (member, checkpoint) in enumerate(zip(self._members, checkpoints, strict=True)):
            if isinstance(self._engine, OffPolicyEngine):
                row = checkpoint.replay_row
                self._engine.replay.restore(index, read_replay(member.record, row), row)
        self._engine.restore([checkpoint.state for checkpoint in checkpoints])
        self._evaluator.restore(position.evaluations, position.last_evaluation)
        if position.last_evaluation == position.control_steps:
            self._note_policies()
        for index, checkpoint in enumerate(checkpoints):
            if not checkpoint.newest:
                self._save_one(index, only=True)

    def _note_episodes(self, returns: NDArray[np.float64], report: Report) -> None:
        """Records the returns (seeds, environments) of the episodes that have just ended."""
        steps = self._engine.control_steps
        self._share_processor_time()
        for index in self._active():
            if not np.isfinite(returns[index]).all():
                self._fail(index, Divergence(self._engine.updates, steps, "episode_return"))
                continue
            losses = self._engine.losses(index)
            for episode_return in returns[index].tolist():
                self._members[index].log.episode(steps, episode_return, EPISODE_STEPS, losses)
                run = self._members[index].settings.id
                report(Event("episode", run, steps=steps, episode_return=episode_return))

    def _evaluate(self) -> None:
        self._fail_diverged(weights=True)
        if not self._active():
            return
        is_last = self._engine.has_made(self._settings.steps)
        evaluations = self._evaluator(self._engine, self._final_episodes if is_last else None)
        self._fail_diverged()
        self._share_processor_time()
        for index in self._active():
            made, log = evaluations[index], self._members[index].log
            log.evaluation(self._engine.control_steps, made.episodes, made.path)
        self._note_policies()

    def _note_policies(self) -> None:
        """Copies the policies of the last evaluation: the last updates may come after it."""
        if self._settings.evaluate_episodes:
            self._evaluated = {index: self._engine.policy(index) for index in self._active()}

    def _save(self) -> None:
        """Commits a checkpoint of every run whose weights are finite."""
        self._fail_diverged(weights=True)
        began = time.perf_counter()
        self._share_processor_time()
        for index in self._active():
            self._save_one(index)
        self._timer.restart(time.perf_counter() - began)

    def _save_one(self, index: int, *, only: bool = False) -> None:
        member = self._members[index]
        member.control_steps = self._engine.control_steps
        if not self._engine.is_resumable:
            member.log.commit()
            return
        member.checkpoint = save(member.record, member.log, self._engine, index, only=only)

    def _end(self) -> None:
        """Makes the final evaluation if it is missing, and finishes all runs."""
        self._fail_diverged(weights=True)
        steps = self._engine.control_steps
        if self._evaluator.last_steps < steps:
            self._evaluate()
        self._share_processor_time()
        for index in self._active():
            log, record = self._members[index].log, self._members[index].record
            log.commit()
            evaluated = self._evaluated.get(index)
            is_same = evaluated is not None and self._engine.keeps_policy_exactly
            summary = {**log.summary(steps, evaluated=is_same), "together": self._sharing}
            kept = newest(record) if self._keep_state else ()
            policy = policy_files(evaluated or self._engine.policy(index))
            record.finish(summary, policy, keep=kept)

    def _fail_diverged(self, *, weights: bool = False) -> None:
        """Fails the runs whose agents have diverged; checking the weights too takes longer."""
        if weights:
            self._engine.check_weights()
        for index, divergence in self._engine.diverged.items():
            if index not in self._failures:
                self._fail(index, divergence)

    def _fail(self, index: int, divergence: Divergence) -> None:
        """Marks one run as failed, with its rows up to now; the others continue."""
        self._share_processor_time()
        member = self._members[index]
        member.log.commit()
        member.record.fail(str(divergence), divergence.to_summary())
        self._failures[index] = DivergedError(divergence)

    def _share_processor_time(self) -> None:
        self._clock.share([self._members[index].log for index in self._active()])

    def _active(self) -> list[int]:
        return [index for index in range(len(self._members)) if index not in self._failures]
