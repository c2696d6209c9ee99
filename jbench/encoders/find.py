"""Encoders of results by name, by id, or by seed, and what changed of their code."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jbench import plugins
from jbench.encoders.load import load_encoder
from jbench.encoders.registry import kind_names, present_code
from jbench.encoders.representations import named_encoder, without_options
from jbench.encoders.settings import EncoderSettings
from jbench.errors import RequestError, WorkError
from jbench.store import Record, Results
from jbench.store.code import ACCEPT, ChangedCodeError, changed_files, since_recorded
from jbench.store.provenance import shell_command
from jbench.store.shipped import results_to_read
from jbench.tasks.find import find_task
from jbench.wording import in_prose, with_results


def find_encoder(
    results: Results | Path | str, name: str, task: str, accept_changed: bool = False
) -> str:
    """Returns the id of an encoder for a task.

    A representation means one whose code is the present one, if its kind is of a user.

    Args:
        name: a representation (see `named_encoder`) for its newest encoder trained on this task
            and the plain robot; a number of latents for a denoising autoencoder; or the id of an
            encoder, or the beginning of a single one.

    Raises:
        RequestError: if there is none that is finished, it encodes the observations of another
            task, or the code of its kind has changed, unless that is accepted.
    """
    results = results_to_read(results)
    find_task(task)
    if plugins.is_imported(name) and name.partition(":")[0] not in kind_names():
        raise _not_an_encoder(results, name, task)

    if name.isdecimal():
        wanted = named_encoder(f"dae{name}", task)
    else:
        wanted = named_encoder(name, task)

    # A kind that was given as MODULE:CLASS is known only by its name in the ids.
    representation = name
    if wanted is not None:
        representation = wanted.representation

    matches = _matches(results, representation, task)
    if not matches and wanted is not None:
        raise RequestError(
            f"No {representation} for {task} in {results.name}; type "
            f"{with_results(wanted.command, results.name)} to make one."
        )
    if not matches:
        return _checked_id(results, name, task, accept_changed)

    candidates = [_Candidate(record, _changed_files(record)) for record in matches]
    best = max(candidates, key=_Candidate.usefulness)
    newest = best.record
    if not newest.is_finished:
        return _checked_id(results, newest.id, task, accept_changed)

    changed = best.changed
    if changed and not accept_changed:
        raise ChangedCodeError(
            f"{since_recorded(newest, changed)}; type "
            f"{with_results(_command(newest), results.name)} to make one of the present code, "
            f"or {ACCEPT}.",
            changed,
        )

    return newest.id


class _Candidate(NamedTuple):
    """An encoder of the name that was asked for, and what has changed of its code since."""

    record: Record
    changed: list[str]

    def usefulness(self) -> tuple[bool, bool, str]:
        """Returns what encoders are ordered by: finished, of the present code, newest."""
        record = self.record
        return record.is_finished, not self.changed, record.manifest.updated


def _checked_id(results: Results, beginning: str, task: str, accept_changed: bool) -> str:
    """Returns the whole id of an encoder, or a RequestError if a run of a task can't use it."""
    id = results.complete_id("encoder", beginning)
    described = load_encoder(results, id, accept_changed, task).description
    if described["task"] == task:
        return id

    asked = {"options": {}} | described | {"task": task}
    wanted = EncoderSettings.model_construct(**asked)
    raise RequestError(
        f"The encoder {id} is for {described['task']}, not for {task}; type "
        f"{with_results(wanted.command, results.name)} to make one."
    )


def _not_an_encoder(results: Results, kind: str, task: str) -> RequestError:
    """Returns the error for a kind MODULE:CLASS that was typed as an encoder: what to type."""
    trained = {
        record.path.parent.name
        for record in results.scan("encoder")[0]
        if record.is_finished
        and record.settings.get("kind") == kind
        and record.settings.get("task") == task
    }
    if trained:
        instead = f"type --encoder {' or --encoder '.join(sorted(trained))}"
    else:
        command = with_results(f"jbench train-encoder --kind {kind} --task {task}", results.name)
        instead = f"type {command} to train one; its last line names it"

    return RequestError(f"{kind} is a kind of encoder, not an encoder; {instead}.")


def _matches(results: Results, representation: str, task: str) -> list[Record]:
    """Returns the encoders of a representation that were trained on a task and the plain robot.

    dae12 is also one of other epochs, noise or the like, if there is none of the default options.
    """
    datasets = results.scan("dataset")[0]
    augmented = {dataset.id for dataset in datasets if dataset.settings.get("augment") is not None}
    of_task = [
        record
        for record in results.scan("encoder")[0]
        if record.settings.get("task") == task
        and str(record.settings.get("dataset")) not in augmented
    ]
    named = [record for record in of_task if record.path.parent.name == representation]
    if named:
        return named

    return [
        record
        for record in of_task
        if record.is_finished and without_options(record.path.parent.name) == representation
    ]


def encoder_code(results: Results, id: str | None) -> dict[str, Any]:
    """Returns provenance of the code of an encoder's kind, under names of a run's encoder.

    There is none for kinds of jbench, and for an encoder that is not in the results.
    """
    record = results.find_readable("encoder", id)
    if record is None:
        return {}
    return {f"encoder_{key}": value for key, value in present_code(record).items()}


def _changed_files(record: Record) -> list[str]:
    """Returns what has changed of the code of an encoder; [] if nothing, or it is not at hand."""
    try:
        now = present_code(record)
    except (RequestError, WorkError):
        return []
    return changed_files(record.manifest.provenance, now)


def _command(record: Record) -> str:
    """Returns the command that makes an encoder with the settings of a recorded one."""
    try:
        return EncoderSettings(**record.settings).command
    except ValueError:
        return shell_command(record.manifest.provenance)


def kept_settings(results: Results, settings: EncoderSettings) -> EncoderSettings:
    """Returns settings with the name that results have such an encoder by.

    Encoders from before options were in names keep their ids; so does a damaged one, which is
    reported by what reads it.
    """
    older = settings.without_names
    if results.has("encoder", older.id):
        return older
    return settings


class Draws(NamedTuple):
    """Encoders that differ only in their seeds.

    Attributes:
        hash: of their settings without the seed.
        ids: of the encoders, by seed.
    """

    hash: str
    ids: dict[int, str]


def find_draws(
    results: Results, name: str, task: str, seeds: Sequence[int], accept_changed: bool = False
) -> Draws:
    """Returns the encoders of these seeds with the settings of the named one.

    Raises:
        RequestError: if there is none for one of the seeds, and as `find_encoder`.
    """
    record = results.find("encoder", find_encoder(results, name, task, accept_changed))
    assert record is not None
    settings = EncoderSettings(**record.settings)
    ids = {seed: settings.model_copy(update={"seed": seed}).id for seed in seeds}
    finished = {each.id for each in results.scan("encoder")[0] if each.is_finished}
    missing = [str(seed) for seed, id in ids.items() if id not in finished]
    if missing:
        raise RequestError(
            f"There is no encoder with the settings of {record.id} and the seed "
            f"{in_prose(missing)} in {results.name}; type "
            f"{with_results(settings.command, results.name)} "
            f"--seed {','.join(missing)} to make it, with the same options."
        )

    return Draws(settings.draws, ids)
