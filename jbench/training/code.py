"""The users' code behind runs: what is present, and which recorded runs a new one joins."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from jbench.agents.find import algorithm_provenance
from jbench.encoders import encoder_code
from jbench.encoders.registry import present_code
from jbench.settings.recorded import COMPARED
from jbench.settings.records import ExternalSettings
from jbench.settings.run import RunSettings
from jbench.sources import checksum
from jbench.store import Record, Results
from jbench.store.code import (
    ACCEPT,
    ChangedCodeError,
    Code,
    changed_files,
    check_code,
    code_hash,
    is_known,
    since_recorded,
)
from jbench.store.planned import Changed, planned, sentences
from jbench.tasks import find


class PlannedRuns(NamedTuple):
    """Settings of runs, and sentences on recorded runs of other code."""

    runs: list[RunSettings]
    notes: list[str]


def run_code(run: RunSettings | ExternalSettings, encoders: Results) -> dict[str, Any]:
    """Returns provenance of the users' code that a run executes; {} if all of it is jbench's.

    The training loop of a recorded run is not known.
    """
    if not isinstance(run, RunSettings):
        return acting_code(run, encoders)
    return {**algorithm_provenance(run.algo), **acting_code(run, encoders)}


def acting_code(run: RunSettings | ExternalSettings, encoders: Results) -> dict[str, Any]:
    """Returns provenance of the users' code with which a run's saved policy acts."""
    return {**find.task_provenance(run.task), **encoder_code(encoders, run.encoder)}


def plan_runs(
    runs: Sequence[RunSettings], results: Results, accept_changed: bool = False
) -> PlannedRuns:
    """Returns runs of one configuration with the ids of the recorded runs of the same code.

    If `accept_changed`, unfinished runs of other code are resumed, and shorter ones whose state was
    kept are continued, as variants of their own. Raises as `find_task` and `find_class`.
    """
    first = runs[0]
    now = run_code(first, results)
    if not is_known(now):
        return PlannedRuns(list(runs), [])
    if first.encoder is not None and accept_changed and _encoder_has_changed(first, results):
        accepted = {"accepted": code_hash(now)}
        return PlannedRuns([run.model_copy(update=accepted) for run in runs], [])

    folder = first.id.rpartition("/")[0]
    records, _ = results.scan("run", f"{folder}/")
    existing = {record.id for record in records}
    free = [*COMPARED]
    if first.encoder_draws is not None:
        free.append("encoder")

    chosen = list[RunSettings]()
    left_alone = list[Changed]()
    others = dict[str, Changed]()
    for run in runs:
        plan = planned(run, records, now, free)
        settings = plan.settings
        if settings.id not in existing:
            others |= {entry.record.id: entry for entry in plan.changed}
            origin = _origin(run, plan.changed)
            if origin is not None:
                others.pop(origin.record.id)
                if accept_changed:
                    settings = _with_accepted_code(run, origin.record, code_hash(now))
                else:
                    left_alone.append(origin)
        chosen.append(settings)

    notes = [
        *sentences(list(others.values())),
        *_on_data_of_other_code(first, results),
        *(_left_alone(origin) for origin in left_alone),
    ]
    return PlannedRuns(chosen, list(dict.fromkeys(notes)))


def check_run_code(run: RunSettings, record: Record | None, now: Code) -> None:
    """Raises a ChangedCodeError if a run is not of the present code.

    Its file may have been edited since the run was planned, or since its record was begun.
    """
    if run.accepted is not None:
        known = run.accepted == code_hash(now)
    else:
        specs = run.specs
        expected = {
            "sources": run.sources,
            "task_sources": specs.sources if specs else None,
        }
        known = all(value in (None, checksum(now.get(key, {}))) for key, value in expected.items())
    if not known:
        raise ChangedCodeError(
            f"The code of the run {run.id} was edited while it waited to begin; type the command "
            "again."
        )
    if record is not None and run.accepted is None:
        check_code(record, now)


def _on_data_of_other_code(run: RunSettings, results: Results) -> list[str]:
    """Returns a sentence if the encoder of a run was trained on data of other code of its task."""
    encoder = results.find_readable("encoder", run.encoder)
    if encoder is None:
        return []
    dataset = results.find_readable("dataset", str(encoder.settings.get("dataset")))
    if dataset is None:
        return []
    files = changed_files(dataset.manifest.provenance, find.task_provenance(run.task))
    if not files:
        return []
    return [
        f"{since_recorded(dataset, files)}. The encoder {encoder.id} was trained on it: jbench "
        "collect and jbench train-encoder make new ones."
    ]


def _encoder_has_changed(run: RunSettings, results: Results) -> bool:
    """Returns whether the code of the kind of a run's encoder has changed since its training."""
    record = results.find_readable("encoder", run.encoder)
    if record is None:
        return False
    return bool(changed_files(record.manifest.provenance, present_code(record)))


def _origin(run: RunSettings, changed: Sequence[Changed]) -> Changed | None:
    """Returns the run of other code that this one would resume or continue, if there is one."""
    for entry in reversed(changed):
        settings = entry.record.settings
        if settings.get("seed") != run.seed or not entry.record.roles():
            continue
        steps = settings.get("steps")
        if entry.record.is_finished:
            if isinstance(steps, int) and steps < run.steps and run.robots == 1:
                return entry
        elif steps == run.steps:
            return entry
    return None


def _with_accepted_code(run: RunSettings, origin: Record, accepted: str) -> RunSettings:
    """Returns the settings of a run that resumes or continues a record, though its code differs."""
    settings = {**origin.settings, "steps": run.steps, "accepted": accepted}
    return RunSettings(**settings)


def _left_alone(origin: Changed) -> str:
    """Returns a sentence on a record that a new run would continue if its code were the same."""
    verb = "continues" if origin.record.is_finished else "resumes"
    return (
        f"{since_recorded(origin.record, origin.files)}, so its seed trains from the beginning "
        f"under another id; {ACCEPT} {verb} it with the present code."
    )
