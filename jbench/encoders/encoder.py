"""An encoder: what it promises, how it is kept, and how one is found."""

import json
from typing import Any, Protocol

from jbench.encoders.dae import TanhEncoder
from jbench.errors import RequestError, WorkError
from jbench.store import Record, Results
from jbench.tasks.features import TASK_SPECS, Array

DESCRIPTION = "encoder.json"
WEIGHTS = "encoder.safetensors"


class Encoder(Protocol):
    """Anything that makes a smaller observation of an observation."""

    @property
    def latent_size(self) -> int:
        """Number of latents."""

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size) of observations (..., dim(O)), same kind."""


def load_encoder(results: Results, id: str) -> tuple[Encoder, dict[str, Any]]:
    """Returns a finished encoder by its id, and its description.

    Raises:
        RequestError: if there is none of that id, or it is unfinished.
        WorkError: if its files are damaged or no encoder.
    """
    record = results.find("encoder", id)
    if record is None:
        known = [record.id for record in results.scan("encoder")[0]]
        there = (
            f"there are {', '.join(known)}" if known else "there is none yet: run jbench train-dae"
        )
        raise RequestError(f"No encoder {id} in {results.path}; {there}.")
    if record.status != "finished":
        raise RequestError(
            f"The encoder {id} is unfinished; type the jbench train-dae command that began it."
        )
    try:
        description = json.loads(record.read_file(DESCRIPTION))
        return TanhEncoder.from_files(description, record.read_file(WEIGHTS)), description
    except (ValueError, KeyError, TypeError) as error:
        raise WorkError(f"The encoder {id} can't be read ({error}); train it anew.") from None


def find_encoder(results: Results, wanted: str, task: str) -> str:
    """Returns the id of the encoder that a user means, for a task.

    Args:
        results: where to look.
        wanted: a number of latents, for the newest denoising autoencoder of that size trained on
            this task, or an encoder's id.
        task: that the agent will learn.

    Raises:
        RequestError: if there is none, or it is one for another task's observations.
    """
    if not wanted.isdecimal():
        _, description = load_encoder(results, wanted)
        if description["task"] != task:
            raise RequestError(
                f"The encoder {wanted} is for {description['task']}, not for {task}; type "
                f"jbench train-dae --task {task} to make one."
            )
        return wanted
    latents, size = int(wanted), TASK_SPECS[task].observation_size
    if not 1 <= latents <= size:
        raise RequestError(
            f"An encoder of {task} has 1 to {size} latents, the size of its observation; "
            f"type --encoder with such a number, or none."
        )
    fitting = [record for record in results.scan("encoder")[0] if _fits(record, task, latents)]
    if not fitting:
        raise RequestError(
            f"No denoising autoencoder of {latents} latents for {task} in {results.path}; type "
            f"jbench train-dae --task {task} --latent {latents} to make one."
        )
    return max(fitting, key=lambda record: record.manifest.updated).id


def _fits(record: Record, task: str, latents: int) -> bool:
    settings = record.settings
    return record.status == "finished" and (
        (settings.get("kind"), settings.get("task"), settings.get("latents"))
        == ("dae", task, latents)
    )
