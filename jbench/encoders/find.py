"""Finding encoders in the results: by representation, by id, or one for each seed."""

from collections.abc import Sequence
from pathlib import Path

from jbench.encoders.registry import SCALES, Wanted, only_size, representation, wanted_encoder
from jbench.encoders.saved import load_encoder
from jbench.encoders.settings import EncoderSettings
from jbench.errors import RequestError, WorkError
from jbench.names import one_of
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
    matches = [
        record
        for record in results.scan("encoder")[0]
        if record.settings.get("task") == task
        and _is_called(name, record, wanted)
        and _has_plain_robot(results, record)
    ]
    if matches:
        newest = max(matches, key=lambda one: (one.status == "finished", one.manifest.updated))
        return newest.id if newest.status == "finished" else _find_id(results, newest.id, task)
    if wanted is None:
        return _find_id(results, name, task)
    size = representation(wanted.kind, wanted.latents, wanted.options)
    raise RequestError(
        f"No {size} for {task} in {results.name}; type "
        f"{with_results(_command(wanted.kind, task, wanted), results.name)} to make one."
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
        wanted = Wanted(settings.kind, settings.latents, settings.scales)
        raise RequestError(
            f"There is no encoder with the settings of {record.id} and the seed "
            f"{one_of(missing)} in {results.name}; type "
            f"{with_results(_command(settings.kind, task, wanted), results.name)} "
            f"--seed {','.join(missing)} to make it, with the same options."
        )
    return settings.draws, ids


def _is_called(name: str, record: Record, wanted: Wanted | None) -> bool:
    """Returns whether an encoder has the kind, size and scales that a name stands for.

    Args:
        wanted: see `wanted_encoder`; None for a kind that was given as MODULE:CLASS, which only the
            representation in the record's id names.
    """
    if wanted is None:
        return record.path.parent.name == name
    settings = record.settings
    options = settings.get("options", {})
    same = (settings.get("kind"), settings.get("latents")) == (wanted.kind, wanted.latents)
    return same and all(options.get(scale) == wanted.options.get(scale) for scale in SCALES)


def _find_id(results: Results, name: str, task: str) -> str:
    """Returns the id that a name or its beginning stands for.

    Raises:
        RequestError: if there is none, or it encodes the observations of another task.
    """
    id = results.complete_id("encoder", name)
    _, description = load_encoder(results, id)
    if description["task"] != task:
        raise RequestError(
            f"The encoder {id} is for {description['task']}, not for {task}; type "
            f"{with_results(_command(description['kind'], task), results.name)} to make one."
        )
    return id


def _command(kind: str, task: str, encoder: Wanted | None = None) -> str:
    """Returns the command that trains an encoder; omits the size of kinds with only one size."""
    options = {} if encoder is None else encoder.options
    verb = "train-dae" if kind == "dae" and not options else f"train-encoder --kind {kind}"
    has_size = encoder is not None and only_size(kind, task) is None
    size = f" --latent {encoder.latents}" if encoder is not None and has_size else ""
    scales = "".join(f" --set {name}={value}" for name, value in options.items())
    return f"jbench {verb} --task {task}{size}{scales}"


def _has_plain_robot(results: Results, record: Record) -> bool:
    """Returns whether an encoder's dataset has the plain robot; True if it is unavailable."""
    try:
        dataset = results.find("dataset", str(record.settings.get("dataset")))
    except (RequestError, WorkError):
        return True
    return dataset is None or dataset.settings.get("augment") is None
