"""Trains the runs of a batch, each from its last checkpoint."""

import contextlib
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple

import torch

from jbench.agents.algorithms import code_of
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.errors import WorkError, sentence_of_failure
from jbench.names import CHECKPOINT_EVERY
from jbench.settings.run import RunSettings
from jbench.simulation import find
from jbench.store import Results
from jbench.store.provenance import device_provenance
from jbench.training.antiphase import divided, number_of_groups, take_turns
from jbench.training.batch_member import Member, begin
from jbench.training.events import Report, ignore
from jbench.training.group import TrainingGroup


def run_batch(
    runs: Sequence[RunSettings],
    results: Results,
    encoder: Encoder | Sequence[Encoder | None] | None,
    *,
    device: str = "auto",
    checkpoint_every: float = CHECKPOINT_EVERY,
    keep_state: bool = False,
    until: int | None = None,
    groups: int | None = None,
    final_episodes: int | None = None,
    report: Report = ignore,
) -> dict[str, WorkError]:
    """Trains and evaluates an agent for each run, and saves the results.

    Finished runs are skipped. A run that was interrupted or failed resumes from its last
    checkpoint, and ends with the same rows and weights as an uninterrupted run. So does a new run
    that continues the longest finished run whose settings differ only in fewer steps, and whose
    state was kept. A run whose agent diverges fails, and keeps its rows and checkpoints up to that
    point. Training is deterministic: resumed with the same versions on the same machine, it
    diverges again.

    Args:
        runs: settings that differ only in their seeds, or that can be one stack (see
            `jbench.settings.alike.stack_key`); one run, if the agent is of another package.
        results: where the runs are written.
        encoder: encoder of the observations of all runs, or one for each run.
        device: see `jbench.devices.find_device`.
        checkpoint_every: minimum seconds between two checkpoints; 0 for one after every episode.
        keep_state: whether to keep the last checkpoint of each run when it finishes.
        until: control step at the end of an episode, where training stops and the runs remain
            unfinished; None to finish them.
        groups: number of groups that are trained in antiphase, with the same results as in one;
            None for what suits the device.
        final_episodes: see `jbench.training.evaluation.final_evaluation_episodes`.
        report: takes an event of each run that resumes, and one after each training episode.

    Returns:
        The error of each failed run by id; a failure does not stop the others.

    Raises:
        RequestError: if the device is unavailable, or the settings are invalid.
        WorkError: if the results can't be written.
    """
    found = find_device(device)
    with contextlib.ExitStack() as locks:
        members, failures = _begin_all(runs, results, encoder, found, report, locks)
        sharing = len(members)
        trainer = _Trainer(
            device, checkpoint_every, keep_state, groups, report, sharing, final_episodes
        )
        while members := [member for member in members if member.is_behind(until)]:
            with _failed_on_error(members):
                failures |= trainer.train(*_furthest_behind(members, until))
    return failures


def _begin_all(
    runs: Sequence[RunSettings],
    results: Results,
    encoder: Encoder | Sequence[Encoder | None] | None,
    device: torch.device,
    report: Report,
    locks: contextlib.ExitStack,
) -> tuple[list[Member], dict[str, WorkError]]:
    """Locks the runs and loads their checkpoints.

    Returns:
        The unfinished runs, and the error of each run that can't be trained by id.
    """
    task_code = find.code_provenance(runs[0].task)
    made_on = {**device_provenance(device), **code_of(runs[0].algo), **task_code}
    encoders = encoder if isinstance(encoder, Sequence) else [encoder] * len(runs)
    members: list[Member] = []
    failures: dict[str, WorkError] = {}
    for run, own_encoder in zip(runs, encoders, strict=True):
        try:
            record = locks.enter_context(results.locked("run", run.id))
            member = begin(run, own_encoder, record, results, made_on, report)
        except WorkError as error:
            failures[run.id] = error
        else:
            members += [member] if member is not None else []
    return members, failures


@contextlib.contextmanager
def _failed_on_error(members: Sequence[Member]) -> Iterator[None]:
    """Marks unfinished runs as failed if the block raises an error."""
    try:
        yield
    except Exception as error:
        for member in members:
            if member.record.status == "unfinished":
                with contextlib.suppress(WorkError):
                    member.record.fail(sentence_of_failure(error))
        raise


def _furthest_behind(
    members: Sequence[Member], until: int | None
) -> tuple[list[Member], int | None]:
    """Returns the members to train first, and the control step at which they stop.

    Seeds may have stopped at different steps: those furthest behind catch up with the next ones.
    """
    behind = min(member.control_steps for member in members)
    ahead = [member.control_steps for member in members if member.control_steps > behind]
    return [m for m in members if m.control_steps == behind], min(ahead, default=until)


class _Trainer(NamedTuple):
    """How the members of a batch are trained; see `run_batch` and `TrainingGroup`."""

    device: str
    checkpoint_every: float
    keep_state: bool
    groups: int | None
    report: Report
    sharing: int
    final_episodes: int | None

    def train(self, members: Sequence[Member], until: int | None) -> dict[str, WorkError]:
        """Trains members at the same control step, and returns the error of each failed run."""
        device = find_device(self.device)
        parts = divided(members, self.groups or number_of_groups(len(members), device))
        groups = [self._train_group(part, until, in_turns=len(parts) > 1) for part in parts]
        failures: dict[str, WorkError] = {}
        for failed in take_turns(groups, device):
            failures |= failed
        return failures

    def _train_group(
        self, members: Sequence[Member], until: int | None, *, in_turns: bool
    ) -> Generator[None, None, dict[str, WorkError]]:
        # Made at the first turn, on the group's stream.
        group = TrainingGroup(
            members,
            self.device,
            self.checkpoint_every,
            self.sharing,
            self.final_episodes,
            keep_state=self.keep_state,
        )
        return (yield from group.train(until, self.report, in_turns=in_turns))
