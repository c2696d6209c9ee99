"""Trains the runs of a batch, each from its last checkpoint."""

import contextlib
from collections.abc import Callable, Sequence
from functools import cache, partial

from jbench.devices import find_device
from jbench.encoders import load_run_encoder
from jbench.errors import ERRORS_OF_OTHERS, RequestError, WorkError, without_exit
from jbench.names import CHECKPOINT_EVERY, KeepState
from jbench.settings.engines import ENGINES
from jbench.settings.run import RunSettings
from jbench.store import Results
from jbench.store.provenance import device_provenance
from jbench.tasks.find import episode_provenance
from jbench.training.beginning import Beginnings
from jbench.training.code import run_code
from jbench.training.events import Report, ignore
from jbench.training.group import TrainingGroup
from jbench.training.member import Member
from jbench.training.recomputed import RecomputedRows


def run_batch(
    runs: Sequence[RunSettings],
    results: Results,
    *,
    encoders: Results | None = None,
    device: str = "auto",
    checkpoint_every: float = CHECKPOINT_EVERY,
    keep_state: KeepState = "no",
    until: int | None = None,
    final_episodes: int | None = None,
    report: Report = ignore,
) -> dict[str, Exception]:
    """Trains and evaluates an agent for each run, and saves the results.

    Finished runs are skipped. Others resume from their last checkpoint, and a new run continues the
    longest finished run whose settings differ only in fewer steps, and whose state was kept. A run
    whose agent diverges fails, and keeps its rows and checkpoints up to that point; resumed, it
    diverges again.

    Args:
        runs: settings that differ only in their seeds, and in their encoders if those have seeds
            of their own; one run, if its engine is not `batched`.
        encoders: where their encoders are; None for `results`.
        device: see `jbench.devices.find_device`.
        checkpoint_every: minimum seconds between two checkpoints; 0 for one after every episode.
        keep_state: what to keep of the last checkpoint of each run when it finishes.
        until: control step at the end of an episode, where training stops and the runs remain
            unfinished; None to finish them.
        final_episodes: see `jbench.training.evaluation.final_evaluation_episodes`.
        report: takes what happens, see `jbench.training.events`.

    Returns:
        The error of each failed run by id; a failure does not stop the others.

    Raises:
        RequestError: if the device is unavailable.
    """
    if not ENGINES[runs[0].engine].is_for_gpu:
        device = "cpu"

    code = run_code(runs[0], encoders or results)
    made_on = {
        **device_provenance(find_device(device)),
        **episode_provenance(runs[0].task),
        **code,
    }
    # Runs of the same encoder share it, and may then encode all their observations at once.
    accepted = runs[0].accepted is not None
    load_encoder = cache(lambda id: load_run_encoder(id, encoders or results, accepted))
    recomputed = RecomputedRows(runs, results, load_encoder, device, report)
    beginnings = Beginnings(results, encoders or results, made_on, recomputed, report)

    members: list[Member] = []
    failures: dict[str, Exception] = {}
    with contextlib.ExitStack() as locks:
        for run in runs:
            try:
                encoder = load_encoder(run.encoder)
                record = locks.enter_context(results.locked("run", run.id))
                if record is None or not record.is_finished:
                    members.append(beginnings.begin(run, encoder, record))
            except (RequestError, WorkError) as error:
                failures[run.id] = error

        make_group = partial(
            TrainingGroup,
            device=device,
            checkpoint_every=checkpoint_every,
            sharing=len(members),
            final_episodes=final_episodes,
            report=report,
            keep_state=keep_state,
        )
        _train(members, make_group, until)

    for member in members:
        if member.failure is not None:
            failures[member.settings.id] = member.failure

    return failures


def _train(
    members: Sequence[Member],
    make_group: Callable[[Sequence[Member]], TrainingGroup],
    until: int | None,
) -> None:
    """Trains members up to a control step (None: to the end), those at the same one together."""
    while True:
        due = [member for member in members if member.is_due(until)]
        if not due:
            break

        # Seeds may have stopped at different steps: those furthest behind catch up first.
        behind = min(member.control_steps for member in due)
        ahead = [member.control_steps for member in due if member.control_steps > behind]
        group = [member for member in due if member.control_steps == behind]
        try:
            make_group(group).train(min(ahead, default=until))
        except ERRORS_OF_OTHERS as error:
            for member in group:
                if member.is_unfinished:
                    member.fail(without_exit(error))
