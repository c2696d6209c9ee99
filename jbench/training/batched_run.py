"""Trains the runs of a batch, each from its last checkpoint."""

import contextlib
import math
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any

from jbench.devices import find_device
from jbench.encoders import Encoder
from jbench.errors import RequestError, WorkError, sentence_of_failure
from jbench.names import CHECKPOINT_EVERY, KeepState
from jbench.settings.engines import ENGINES
from jbench.settings.run import RunSettings
from jbench.store import Record, Results
from jbench.store.code import code_of
from jbench.store.files import UnreadableError
from jbench.store.provenance import describe_changes, device_provenance, provenance
from jbench.tasks.find import episode_provenance
from jbench.training.checkpoints import copied, load
from jbench.training.code import check_run_code, run_code
from jbench.training.evaluation import load_run_encoder
from jbench.training.events import Report, Resumed, ignore
from jbench.training.group import Member, TrainingGroup
from jbench.training.log import RunLog
from jbench.training.recomputed import RecomputedRows, noted
from jbench.training.status import kept_runs, obstacle


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

    Returns the error of each failed run by id; a failure does not stop the others. Raises a
    RequestError if the device is unavailable.
    """
    if not ENGINES[runs[0].engine].is_for_gpu:
        device = "cpu"
    code = run_code(runs[0], encoders or results)
    made_on = {
        **device_provenance(find_device(device)),
        **episode_provenance(runs[0].task),
        **code,
    }
    end = until or math.inf
    members: list[Member] = []
    failures: dict[str, Exception] = {}
    # Runs of the same encoder share it, and may then encode all their observations at once.
    accepted = runs[0].accepted is not None
    load_encoder = cache(lambda id: load_run_encoder(id, encoders or results, accepted))
    recomputed = RecomputedRows(runs, results, load_encoder, device, report)
    with contextlib.ExitStack() as locks:
        for run in runs:
            try:
                encoder = load_encoder(run.encoder)
                record = locks.enter_context(results.locked("run", run.id))
                member = _begin(run, encoder, record, results, made_on, recomputed, report)
            except (RequestError, WorkError) as error:
                failures[run.id] = error
            else:
                members += [] if member is None else [member]
        make_group = partial(
            TrainingGroup,
            device=device,
            checkpoint_every=checkpoint_every,
            sharing=len(members),
            final_episodes=final_episodes,
            report=report,
            keep_state=keep_state,
        )
        while due := [m for m in members if m.is_unfinished and m.control_steps < end]:
            # Seeds may have stopped at different steps: those furthest behind catch up first.
            behind = min(member.control_steps for member in due)
            ahead = [member.control_steps for member in due if member.control_steps > behind]
            group = [member for member in due if member.control_steps == behind]
            try:
                make_group(group).train(min(ahead, default=until))
            except Exception as error:
                for member in group:
                    if member.is_unfinished:
                        member.failure = error
                        with contextlib.suppress(WorkError):
                            member.log.commit()
                        with contextlib.suppress(WorkError):
                            member.record.fail(sentence_of_failure(error))
    return failures | {m.settings.id: m.failure for m in members if m.failure is not None}


def _begin(
    run: RunSettings,
    encoder: Encoder | None,
    record: Record | None,
    results: Results,
    made_on: Mapping[str, Any],
    recomputed: RecomputedRows,
    report: Report,
) -> Member | None:
    """Returns a run to train, from its checkpoint or that of a shorter run; None if finished."""
    if record is not None and record.status == "finished":
        return None
    check_run_code(run, record, made_on)
    refused: list[str] = []
    shorter = kept_runs(run, results)
    for source in shorter if record is None else (record, *shorter):
        checkpoint, damaged = load(source)
        refused += damaged
        if checkpoint is None:
            continue
        position = checkpoint.position
        rows = recomputed.take(run, source, checkpoint)
        try:
            log = RunLog(source, position)
            copy = None if source is record else copied(checkpoint, source, run.id, rows)
        except UnreadableError:
            raise  # the rows may be intact: keep them
        except WorkError as error:
            refused.append(f"{error.reason}.")
            continue
        resumed, continues = source, ""
        if copy is not None:
            # The rows were made there and then, but by another command.
            before = {**source.manifest.provenance, "command": provenance()["command"]}
            resumed, continues = results.create("run", run.id, run.values, before), source.id
            resumed.append(*copy)
            log = RunLog(resumed, position)
        steps = position.control_steps
        where: dict[str, Any] = {"control_steps": steps}
        if continues:
            where["run"] = continues
        if run.accepted is not None:
            where["code"] = code_of(made_on)
        where |= noted(rows)
        if changed := resumed.resume(where, made_on):
            refused.append(
                f"Since it began, {describe_changes(changed)}: results may differ from those of "
                "an uninterrupted run."
            )
        report(Resumed(run.id, steps, continues, " ".join(refused)))
        return Member(run, encoder, resumed, log, checkpoint._replace(compact=None), steps)
    if record is not None or refused:
        if reason := obstacle(run, finished=False):
            refused.append(f"{reason[0].upper()}{reason[1:]}, so its runs can't be resumed.")
        continues = shorter[0].id if shorter and record is None else ""
        report(Resumed(run.id, 0, continues, " ".join(refused)))
    record = results.create("run", run.id, run.values, made_on)
    return Member(run, encoder, record, RunLog(record))
