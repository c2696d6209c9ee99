"""Trains runs in one engine, and commits their rows and checkpoints."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np

from jbench.agents.divergence import DivergedError
from jbench.agents.environments import Ends
from jbench.errors import WorkError
from jbench.names import KeepState
from jbench.settings.engines import ENGINES
from jbench.tasks.worlds import EpisodeError
from jbench.timing import part
from jbench.training import evaluation
from jbench.training.checkpoints import save
from jbench.training.engines import make_engine
from jbench.training.events import EpisodeEnded, Note, Report
from jbench.training.kept_state import kept_state
from jbench.training.log import CommitTimer, ProcessorClock
from jbench.training.member import Member
from jbench.training.replay_pieces import stored_rows
from jbench.wording import counted


class TrainingGroup:
    """Runs that are trained together, all at the same control step."""

    def __init__(
        self,
        members: Sequence[Member],
        *,
        device: str,
        checkpoint_every: float,
        sharing: int,
        final_episodes: int | None,
        report: Report,
        keep_state: KeepState,
    ) -> None:
        """Makes or restores the engine; `sharing` runs, also at other steps, share the process."""
        self._members = members
        self._sharing = sharing
        self._report = report
        self._keep_state = keep_state
        self._processor_clock = ProcessorClock()
        self._commit_timer = CommitTimer(checkpoint_every)
        self._settings = members[0].settings
        self._final_episodes = evaluation.final_evaluation_episodes(self._settings, final_episodes)

        runs = [member.settings for member in members]
        encoders = [member.encoder for member in members]
        self._engine = make_engine(runs, encoders, device)
        if members[0].checkpoint is None:
            return

        with ExitStack() as stack:
            stack.enter_context(self._engine)  # closes it if it can't be restored
            self._restore()
            stack.pop_all()

    def train(self, until: int | None) -> None:
        """Trains to a control step (None: to the end), or until all runs have failed."""
        self._until = until
        with self._engine as engine:
            try:
                engine.train(self._settings.steps, self._after_step)
            except EpisodeError as error:  # of the loop of stable-baselines3, with one run
                for _, member in self._active():
                    self._fail(member, error)
            if until is None:
                self._end()
            else:
                self._save()

    def _after_step(self, ends: Ends | None) -> bool:
        """Writes what is due after a control step, with the episodes that ended, if any.

        Returns whether to go on.
        """
        self._fail_diverged()
        self._fail_with(self._engine.failures)
        steps = self._engine.control_steps
        if ends is not None and self._active():
            with part("rows"):
                self._note_episodes(ends)

        active = self._active()
        if not active:
            return False
        if active[0].member.log.is_evaluation_due(self._settings.evaluate_every, steps):
            self._evaluate()
        if steps == self._until:
            return False
        is_last = self._keep_state != "no" and self._engine.has_made(self._settings.steps)
        if is_last or (ends is not None and self._commit_timer.is_due()):
            self._save()
        return True

    def _restore(self) -> None:
        """Continues all members from their checkpoints, which are at the same control step."""
        checkpoints = [m.checkpoint for m in self._members if m.checkpoint is not None]
        pairs = [*zip(self._members, checkpoints, strict=True)]
        replay = self._engine.replay
        for index, (member, checkpoint) in enumerate(pairs):
            if replay is not None:
                row = checkpoint.replay_row
                replay.restore(index, stored_rows(member.record, row), row)

        self._engine.restore([checkpoint.state for checkpoint in checkpoints])
        if self._engine.truncated_at_restore is not None:
            self._note_truncated(self._engine.truncated_at_restore)
        position = checkpoints[0].position
        if position.last_evaluation == position.control_steps:
            self._note_policies()
        for index, (member, checkpoint) in enumerate(pairs):
            if not checkpoint.is_newest:
                with member.failing_alone():
                    self._save_one(index, drop_others=True)

    def _note_truncated(self, ends: Ends) -> None:
        """Records the episodes that were truncated, since they could not be repeated."""
        self._note_episodes(ends)
        control_steps = self._engine.control_steps
        for index, member in self._active():
            count = int(ends.ended[index].sum())
            if count:
                truncated = {"control_steps": control_steps, "episodes": count}
                with member.failing_alone():
                    member.record.note({"truncated": truncated})
                sentence = (
                    f"The run {member.settings.id}: {counted(count, 'episode')} did not repeat "
                    "from the seed and the actions so far, and ended by truncation at control "
                    f"step {control_steps:,}, where the run was saved."
                )
                self._report(Note(sentence))

    def _note_episodes(self, ends: Ends) -> None:
        """Records the episodes that have just ended."""
        control_steps = self._engine.control_steps
        self._share_processor_time()
        for index, member in self._active():
            ended = ends.ended[index]
            if not ended.any():
                continue
            returns = ends.returns[index, ended]
            if not np.isfinite(returns).all():
                self._fail(
                    member, DivergedError(self._engine.updates, control_steps, "episode_return")
                )
                continue
            losses = self._engine.losses(index)
            lengths = ends.lengths[index, ended].tolist()
            for episode_return, length in zip(returns.tolist(), lengths, strict=True):
                member.log.episode(control_steps, episode_return, losses, length)
                self._report(EpisodeEnded(member.settings.id, control_steps, episode_return))

    def _evaluate(self) -> None:
        """Evaluates the policies of all active members side by side, and adds the rows to logs."""
        with part("evaluation"):
            self._fail_diverged(weights=True)
            if not self._active():
                return
            evaluations = self._evaluate_policies()
            self._fail_diverged()
            self._share_processor_time()
            for index, member in self._active():
                made = evaluations[index]
                if made.failure is not None:
                    self._fail(member, made.failure)
                    continue
                returns = made.returns.tolist()
                lengths = made.lengths.tolist()
                member.log.evaluation(self._engine.control_steps, returns, lengths, made.path)
            self._note_policies()

    def _evaluate_policies(self) -> list[evaluation.Evaluation]:
        """Returns an evaluation of each policy of the engine, also of those that have failed."""
        settings = self._settings
        engine = self._engine
        first = self._active()[0].member  # all have as many evaluations
        is_final = engine.has_made(settings.steps)
        return evaluation.evaluate_policies(
            settings,
            [evaluation.derive_seeds(member.settings.seed).evaluations for member in self._members],
            first.log.progress.evaluations,
            engine.act,
            threads=engine.threads,
            control_steps=engine.control_steps,
            episodes=self._final_episodes if is_final else None,
        )

    def _note_policies(self) -> None:
        """Remembers the policies that have just been evaluated."""
        if self._settings.evaluate_episodes:
            for index, member in self._active():
                member.evaluated = self._engine.policy(index)

    def _save(self) -> None:
        """Commits the rows and a checkpoint of each active member."""
        self._fail_diverged(weights=True)
        with part("checkpoints"), self._commit_timer.committing():
            self._share_processor_time()
            for index, member in self._active():
                with member.failing_alone():
                    self._save_one(index)

    def _save_one(self, index: int, *, drop_others: bool = False) -> None:
        """Commits the rows and a checkpoint of one run; see `save`."""
        member = self._members[index]
        engine = self._engine
        member.control_steps = engine.control_steps
        member.checkpoint = save(member.record, member.log, engine, index, drop_others=drop_others)

    def _end(self) -> None:
        """Evaluates the last policies, unless they were, and finishes all active members."""
        self._fail_diverged(weights=True)
        steps = self._engine.control_steps
        if any(m.log.progress.last_evaluation < steps for _, m in self._active()):
            self._evaluate()

        self._share_processor_time()
        for index, member in self._active():
            with member.failing_alone():
                member.log.commit()
                self._finish(index, member)

    def _finish(self, index: int, member: Member) -> None:
        """Finishes the record of a member, with its policy and the state that is to be kept."""
        facts = ENGINES[self._settings.engine]
        is_same = member.evaluated is not None and facts.copies_round_alike
        summary = member.log.summary(self._engine.control_steps, evaluated=is_same)
        policy = member.evaluated or self._engine.policy(index)
        policy_files = {}
        if policy is not None:
            policy_files = policy.files()

        kept = kept_state(
            self._keep_state, member.record, member.checkpoint, self._engine.replay, index
        )
        if kept.reason is not None:
            what = f"The state of {member.settings.id} is kept with its replay buffer"
            self._report(Note(f"{what}: {kept.reason}."))

        member.record.finish(
            {**summary, "together": self._sharing},
            policy_files,
            keep=kept.roles,
            checkpoints=kept.files,
        )

    def _fail_diverged(self, *, weights: bool = False) -> None:
        """Fails the runs whose agents have diverged; checking the weights too takes longer."""
        if weights:
            self._engine.check_weights()
        self._fail_with(self._engine.diverged)

    def _fail_with(self, errors: Mapping[int, DivergedError] | Mapping[int, EpisodeError]) -> None:
        """Fails the runs that have errors, by their index, unless they have failed before."""
        for index, error in errors.items():
            member = self._members[index]
            if member.failure is None:
                self._fail(member, error)

    def _fail(self, member: Member, error: DivergedError | EpisodeError) -> None:
        """Commits the pending rows of a run, and marks it as failed."""
        self._share_processor_time()
        failure: WorkError = error
        if isinstance(error, EpisodeError):
            made = counted(self._engine.control_steps, "control step")
            sentence = f"{str(error).rstrip('.')}; the run had made {made}."
            failure = WorkError(sentence)

        with member.failing_alone():
            member.log.commit()
            member.record.fail(str(failure), error.summary)
            member.failure = failure

    def _share_processor_time(self) -> None:
        """Divides the processor time since the last call among the runs that go on."""
        self._processor_clock.share([member.log for _, member in self._active()])

    def _active(self) -> list["_Active"]:
        """Returns the runs that have not failed."""
        members = enumerate(self._members)
        return [_Active(place, member) for place, member in members if member.failure is None]


class _Active(NamedTuple):
    """A run that has not failed, and its place in the engine."""

    place: int
    member: Member
