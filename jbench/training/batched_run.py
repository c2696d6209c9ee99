"""Trains the runs of a batch, each from its last checkpoint."""

import contextlib
from collections.abc import Iterator, Sequence

import torch

from jbench.agents.algorithms import algorithm_provenance
from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.errors import WorkError, sentence_of_failure
from jbench.names import CHECKPOINT_EVERY
from jbench.settings.run import RunSettings
from jbench.simulation import find
from jbench.store import Results
from jbench.store.provenance import device_provenance
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
        runs: settings that differ only in their seeds, and in their encoders if those have seeds
            of their own; one run, if the agent is of another package.
        results: where the runs are written.
        encoder: encoder of the observations of all runs, or one for each run.
        device: see `jbench.devices.find_device`.
        checkpoint_every: minimum seconds between two checkpoints; 0 for one after every episode.
        keep_state: whether to keep the last checkpoint of each run when it finishes.
        until: control step at the end of an episode, where training stops and the runs remain
            unfinished; None to finish them.
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
        while members := [member for member in members if member.is_behind(until)]:
            # Seeds may have stopped at different steps: those furthest behind catch up first.
            behind = min(member.control_steps for member in members)
            ahead = [member.control_steps for member in members if member.control_steps > behind]
            with _failed_on_error(members):
                failures |= TrainingGroup(
                    [member for member in members if member.control_steps == behind],
                    device,
                    checkpoint_every,
                    sharing,
                    final_episodes,
                    keep_state=keep_state,
                ).train(min(ahead, default=until), report)
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
    made_on = {**device_provenance(device), **algorithm_provenance(runs[0].algo), **task_code}
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
