"""Finding encoders in the results: by representation, by id, or one for each seed."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jbench.encoders.registry import EncoderSettings, named_encoder
from jbench.encoders.saved import DESCRIPTION, WEIGHTS, Encoder, SavedEncoder
from jbench.errors import RequestError, WorkError
from jbench.names import in_prose
from jbench.simulation import find_task
from jbench.store import Record, Results
from jbench.store.provenance import shell_command
from jbench.store.shipped import results_to_read
from jbench.wording import with_results


def find_encoder(results: Results | Path | str, name: str, task: str) -> str:
    """Returns the id of an encoder for a task.

    Args:
        name: a representation (see `named_encoder`) for its newest encoder trained on this task
            and the plain robot; a number of latents for a denoising autoencoder; or the id of an
            encoder, or the beginning of a single one.

    Raises:
        RequestError: if there is none that is finished, or it encodes the observations of another
            task.
    """
    results = results_to_read(results)
    find_task(task)
    wanted = named_encoder(f"dae{name}" if name.isdecimal() else name, task)
    # A kind that was given as MODULE:CLASS is known only by its name in the ids.
    representation = name if wanted is None else wanted.representation
    matches = [
        record
        for record in results.scan("encoder")[0]
        if record.settings.get("task") == task
        and record.path.parent.name == representation
        and _has_plain_robot(results, record)
    ]
    if matches:
        newest = max(
            matches, key=lambda match: (match.status == "finished", match.manifest.updated)
        )
        if newest.status == "finished":
            return newest.id
        name = newest.id
    elif wanted is not None:
        raise RequestError(
            f"No {representation} for {task} in {results.name}; type "
            f"{with_results(wanted.command, results.name)} to make one."
        )
    id = results.complete_id("encoder", name)
    _, description = load_encoder(results, id)
    if description["task"] != task:
        wanted = EncoderSettings.model_construct(**{"options": {}, **description, "task": task})
        raise RequestError(
            f"The encoder {id} is for {description['task']}, not for {task}; type "
            f"{with_results(wanted.command, results.name)} to make one."
        )
    return id


def find_draws(
    results: Results, name: str, task: str, seeds: Sequence[int]
) -> tuple[str, dict[int, str]]:
    """Returns the encoders of each seed that have the settings of the named one otherwise.

    They are the hash of the settings without the seed, and the id of each seed's encoder.

    Raises:
        RequestError: if there is none for one of the seeds.
    """
    record = results.find("encoder", find_encoder(results, name, task))
    assert record is not None
    settings = EncoderSettings(**record.settings)
    ids = {seed: settings.model_copy(update={"seed": seed}).id for seed in seeds}
    finished = {r.id for r in results.scan("encoder")[0] if r.status == "finished"}
    missing = [str(seed) for seed, id in ids.items() if id not in finished]
    if missing:
        raise RequestError(
            f"There is no encoder with the settings of {record.id} and the seed "
            f"{in_prose(missing)} in {results.name}; type "
            f"{with_results(settings.command, results.name)} "
            f"--seed {','.join(missing)} to make it, with the same options."
        )
    return settings.draws, ids


def load_encoder(results: Results | Path | str, id: str) -> tuple[Encoder, dict[str, Any]]:
    """Returns a finished encoder and its description.

    Raises:
        RequestError: if the encoder does not exist or is unfinished.
        WorkError: if its files are damaged or invalid.
    """
    results = results_to_read(results)
    record = results.find("encoder", id)
    if record is None:
        ids = [record.id for record in results.scan("encoder")[0] if record.status == "finished"]
        command = with_results("jbench train-dae", results.name)
        none = f"there is none yet: run {command}, or jbench train-encoder for another kind"
        there = f"there are {', '.join(ids)}" if ids else none
        raise RequestError(
            f"No encoder {id} in {results.name}; {there}. A kind with a number of latents, such as "
            "dae12, selects the newest one."
        )
    if record.status != "finished":
        command = shell_command(record.manifest.provenance)
        raise RequestError(f"The encoder {id} is unfinished; repeat `{command}` to finish it.")
    try:
        description = json.loads(record.read_file(DESCRIPTION))
        return SavedEncoder.from_files(description, record.read_file(WEIGHTS)), description
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise WorkError(f"The encoder {id} can't be read ({error}); train it again.") from None


def _has_plain_robot(results: Results, record: Record) -> bool:
    """Returns whether a dataset has the plain robot, or is unavailable."""
    try:
        dataset = results.find("dataset", str(record.settings.get("dataset")))
    except (RequestError, WorkError):
        return True
    return dataset is None or dataset.settings.get("augment") is None
