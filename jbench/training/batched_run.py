"""Runs that differ in their seeds alone, side by side on the batched engine."""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jbench.agents.batched.engine import Engine
from jbench.agents.batched.make import device_of, make_engine
from jbench.agents.batched.off_policy import OffPolicyEngine
from jbench.agents.divergence import DivergedError, Divergence
from jbench.encoders import Encoder
from jbench.errors import WorkError
from jbench.names import CHECKPOINT_EVERY, EPISODE_STEPS
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.files import UnreadableError
from jbench.store.provenance import device_provenance
from jbench.training.checkpoints import Checkpoint, load, read_replay, save
from jbench.training.evaluation import Evaluator, robot_model
from jbench.training.log import Pace, Position, ProcessorClock, RunLog

Progress = Callable[[RunSettings, int, float], None]
"""Told after each training episode: the run, its control steps so far, and the return."""

Notice = Callable[[RunSettings, int, str], None]
"""Told of a run that was begun before: the control steps from which it goes on, and a sentence."""


def run_batch(
    runs: Sequence[RunSettings],
    results: Results,
    encoder: Encoder | None,
    *,
    device: str = "auto",
    checkpoint_every: float = CHECKPOINT_EVERY,
    progress: Progress = lambda run, steps, episode_return: None,
    notice: Notice = lambda run, steps, sentence: None,
) -> dict[str, WorkError]:
    """Trains and evaluates an agent for each run, and keeps what came out.

    A run that is finished is left as it is; one that was interrupted or failed is resumed from its
    last checkpoint, and ends in the same rows and weights as if it had never stopped. A run whose
    agent diverges fails when that is seen, and keeps its rows and checkpoints until then. Training
    is deterministic: resumed with the same versions on the same machine, it diverges again.

    Args:
        runs: of settings that differ in their seeds alone.
        results: where they go.
        encoder: of their observations.
        device: to learn on: one of `jbench.names.DEVICES`.
        checkpoint_every: seconds between two checkpoints, at least; 0 for each end of an episode.
        progress: told of each training episode.
        notice: told of each run that was begun before.

    Returns:
        The error of each run that failed, by its id; one failure does not stop the others.

    Raises:
        RequestError: if the device is not there, or the settings can't be shared out.
        WorkError: if the results can't be written.
    """
    failures: dict[str, WorkError] = {}
    made_on = device_provenance(device_of(device))
    with contextlib.ExitStack() as locks:
        members = []
        for run in runs:
            try:
                found = locks.enter_context(results.locked("run", run.id))
                member = _begin(run, found, results, made_on, notice)
            except WorkError as error:
                failures[run.id] = error
                continue
            if member is not None:
                members.append(member)
        try:
            while members:
                # Seeds that were stopped at different steps: those behind catch up first.
                behind = min(member.control_steps for member in members)
                ahead = {m.control_steps for m in members if m.control_steps > behind}
                group = [member for member in members if member.control_steps == behind]
                batch = _Batch(group, encoder, device, Pace(checkpoint_every))
                failures |= batch.train(min(ahead, default=None), progress)
                members = [m for m in members if m.record.status == "unfinished"]
        except Exception as error:
            for member in members:
                if member.record.status == "unfinished":
                    with contextlib.suppress(WorkError):
                        member.record.fail(f"{type(error).__name__}: {error}")
            raise
    return failures


@dataclass
class _Member:
    """A run of a batch."""

    settings: RunSettings
    record: Record
    log: RunLog
    checkpoint: Checkpoint | None = None

    @property
    def control_steps(self) -> int:
        """From which it goes on."""
        return 0 if self.checkpoint is None else self.checkpoint.position.control_steps


def _begin(
    run: RunSettings,
    record: Record | None,
    results: Results,
    made_on: Mapping[str, str | None],
    notice: Notice,
) -> _Member | None:
    """Returns a run that is to be done, from its last checkpoint or from nothing."""
    if record is not None and record.status == "finished":
        return None
    if record is not None:
        checkpoint, refused = load(record)
        try:
            log = None if checkpoint is None else RunLog(record, checkpoint.position)
        except UnreadableError:
            raise  # the rows may be intact: nothing is given up
        except WorkError as error:  # rows are damaged
            log, refused = None, [str(error).partition(";")[0] + "."]
        if checkpoint is not None and log is not None:
            where = {"control_steps": checkpoint.position.control_steps}
            changed = record.resume(where, made_on)
            sentences = [*refused, *_changes(changed)]
            notice(run, checkpoint.position.control_steps, " ".join(sentences))
            return _Member(run, record, log, checkpoint)
        notice(run, 0, " ".join(refused))
    record = results.create("run", run.id, run.model_dump(mode="json"), made_on)
    return _Member(run, record, RunLog(record))


def _changes(changed: Mapping[str, Sequence[object]]) -> list[str]:
    """Returns a sentence if versions, processor or device are not those that a run began with."""
    if not changed:
        return []
    changes = ", ".join(f"{name} {before} is now {now}" for name, (before, now) in changed.items())
    return [f"Since it began, {changes}: its numbers may differ from those of an unbroken run."]


class _Batch:
    """The runs of a batch while they are trained side by side, all at the same control step."""

    def __init__(
        self, members: Sequence[_Member], encoder: Encoder | None, device: str, pace: Pace
    ) -> None:
        self._members, self._pace = members, pace
        self._clock = ProcessorClock()
        self._failures: dict[int, WorkError] = {}
        self._settings = settings = members[0].settings
        seeds = [np.random.SeedSequence(m.settings.seed).generate_state(2) for m in members]
        self._engine = engine_of(settings, [int(seed) for seed, _ in seeds], encoder, device)
        self._evaluator = Evaluator(settings, [int(seed) for _, seed in seeds])
        if members[0].checkpoint is not None:
            self._restore(members[0].checkpoint.position)

    def train(self, until: int | None, progress: Progress) -> dict[str, WorkError]:
        """Trains to a control step, or for None to the last evaluation, or until all have failed.

        Returns:
            The error of each run that failed, by its id.
        """
        with self._engine as engine:
            for returns in engine.learn(self._settings.steps):
                self._fail_diverged()
                if not self._going_on():
                    break
                if returns is not None:
                    self._note_episodes(returns, progress)
                if self._evaluator.due(engine.control_steps):
                    self._evaluate()
                if engine.control_steps == until:
                    break
                if returns is not None and self._pace.due():
                    self._save()
            if until is None:
                self._end()
            else:
                self._save()
        return {self._members[place].settings.id: e for place, e in self._failures.items()}

    def _restore(self, position: Position) -> None:
        """Puts everything where the checkpoints of the runs found it."""
        checkpoints = [m.checkpoint for m in self._members if m.checkpoint is not None]
        for place, (member, checkpoint) in enumerate(zip(self._members, checkpoints, strict=True)):
            if isinstance(self._engine, OffPolicyEngine):
                row = checkpoint.replay_row
                self._engine.restore_rows(place, read_replay(member.record, row), row)
        self._engine.restore([checkpoint.state for checkpoint in checkpoints])
        self._evaluator.restore(position.evaluations, position.last_evaluation)
        for place, checkpoint in enumerate(checkpoints):
            if not checkpoint.newest:
                self._save_one(place, only=True)

    def _note_episodes(self, returns: NDArray[np.float64], progress: Progress) -> None:
        """Writes down the episodes (seeds, environments) that have just ended."""
        steps = self._engine.control_steps
        self._share_processor_time()
        for place in self._going_on():
            if not np.isfinite(returns[place]).all():
                self._fail(place, Divergence(self._engine.updates, steps, "episode_return"))
                continue
            losses = self._engine.losses(place)
            for episode_return in returns[place].tolist():
                self._members[place].log.episode(steps, episode_return, EPISODE_STEPS, losses)
                progress(self._members[place].settings, steps, episode_return)

    def _evaluate(self) -> None:
        self._fail_diverged(weights=True)
        if not self._going_on():
            return
        returns = self._evaluator(self._engine)
        self._share_processor_time()
        for place in self._going_on():
            outcome = [(value, EPISODE_STEPS) for value in returns[place].tolist()]
            self._members[place].log.evaluation(self._engine.control_steps, outcome)

    def _save(self) -> None:
        """Commits a checkpoint of every run; none of weights that are not finite."""
        self._fail_diverged(weights=True)
        began = time.perf_counter()
        self._share_processor_time()
        for place in self._going_on():
            self._save_one(place)
        self._pace.spent(time.perf_counter() - began)

    def _save_one(self, place: int, *, only: bool = False) -> None:
        member = self._members[place]
        member.checkpoint = save(member.record, member.log, self._engine, place, only=only)

    def _end(self) -> None:
        """Makes the last evaluation, if it is not made yet, and ends all runs."""
        self._fail_diverged(weights=True)
        steps = self._engine.control_steps
        if self._evaluator.last_steps < steps:
            self._evaluate()
        together = len(self._members)
        self._share_processor_time()
        for place in self._going_on():
            log, record = self._members[place].log, self._members[place].record
            log.commit()
            summary = {**log.summary(steps), "together": together}
            record.finish(summary, self._engine.policy(place).to_files())

    def _fail_diverged(self, *, weights: bool = False) -> None:
        """Fails the runs whose agents have diverged.

        Args:
            weights: whether to look at all weights too, which takes longer.
        """
        if weights:
            self._engine.check_weights()
        for place, divergence in self._engine.diverged.items():
            if place not in self._failures:
                self._fail(place, divergence)

    def _fail(self, place: int, divergence: Divergence) -> None:
        """Fails one run, which keeps its rows until now; the others are trained on."""
        self._share_processor_time()
        member = self._members[place]
        member.log.commit()
        member.record.fail(str(divergence), divergence.to_summary())
        self._failures[place] = DivergedError(divergence)

    def _share_processor_time(self) -> None:
        self._clock.share([self._members[place].log for place in self._going_on()])

    def _going_on(self) -> list[int]:
        return [place for place in range(len(self._members)) if place not in self._failures]


def engine_of(
    settings: RunSettings, seeds: Sequence[int], encoder: Encoder | None, device: str
) -> Engine:
    """Returns the engine of runs with these settings.

    Args:
        settings: of the runs; their seed does not matter.
        seeds: of the agents.
        encoder: of their observations.
        device: one of `jbench.names.DEVICES`.
    """
    return make_engine(
        settings.algo,
        settings.algorithm,
        settings.task,
        seeds,
        environments=settings.environments,
        time_limit=settings.time_limit,
        encoder=encoder,
        ofe=settings.ofe,
        models=lambda episode: robot_model(settings, episode // settings.episodes_on_each),
        device=device,
        precision=settings.precision,
    )
