"""Finding encoders in the results: by representation, by id, or one for each seed."""

from collections.abc import Sequence
from pathlib import Path

from jbench.encoders.registry import Wanted, wanted_encoder
from jbench.encoders.saved import load_encoder
from jbench.encoders.settings import EncoderSettings
from jbench.errors import RequestError, WorkError
from jbench.names import in_prose
from jbench.simulation import find_task
from jbench.store import Record, Results
from jbench.store.shipped import results_to_read
from jbench.wording import with_results


def find_encoder(results: Results | Path | str, name: str, task: str) -> str:
    """Returns the id of an encoder for a task.

    Args:
        name: a representation (see `wanted_encoder`) for its newest encoder trained on this task
            and the plain robot; a number of latents for a denoising autoencoder; or the id of an
            encoder, or the beginning of a single one.

    Raises:
        RequestError: if there is none that is finished, or it encodes the observations of another
            task.
    """
    results = results_to_read(results)
    find_task(task)
    wanted = wanted_encoder(f"dae{name}" if name.isdecimal() else name, task)
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
        return newest.id if newest.status == "finished" else _find_id(results, newest.id, task)
    if wanted is None:
        return _find_id(results, name, task)
    raise RequestError(
        f"No {representation} for {task} in {results.name}; type "
        f"{with_results(wanted.command(task), results.name)} to make one."
    )


def find_draws(
    results: Results, name: str, task: str, seeds: Sequence[int]
) -> tuple[str, dict[int, str]]:
    """Returns the encoders of each seed that have the settings of the named one otherwise.

    Args:
        name: see `find_encoder`.

    Returns:
        The hash of the settings without the seed, and the id of each seed's encoder.

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
            f"{with_results(settings.wanted.command(task), results.name)} "
            f"--seed {','.join(missing)} to make it, with the same options."
        )
    return settings.draws, ids


def _find_id(results: Results, name: str, task: str) -> str:
    """Returns the id that a name or its beginning stands for.

    Raises:
        RequestError: if there is none, or it encodes the observations of another task.
    """
    id = results.complete_id("encoder", name)
    _, description = load_encoder(results, id)
    if description["task"] != task:
        options = description.get("options", {})
        wanted = Wanted(description["kind"], description["latents"], options)
        raise RequestError(
            f"The encoder {id} is for {description['task']}, not for {task}; type "
            f"{with_results(wanted.command(task), results.name)} to make one."
        )
    return id


def _has_plain_robot(results: Results, record: Record) -> bool:
    """Returns whether an encoder's dataset has the plain robot; True if it is unavailable."""
    try:
        dataset = results.find("dataset", str(record.settings.get("dataset")))
    except (RequestError, WorkError):
        return True
    return dataset is None or dataset.settings.get("augment") is None
