"""An encoder: what it promises, how it is kept, and how one is found."""

import json
from typing import Any, Protocol

import numpy as np
import safetensors
import safetensors.numpy
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Kind
from jbench.encoders.registry import find_kind, kind_names, make_kind
from jbench.encoders.scaling import Scaling
from jbench.errors import RequestError, WorkError
from jbench.names import known
from jbench.store import Record, Results
from jbench.tasks.features import Array

DESCRIPTION = "encoder.json"
WEIGHTS = "encoder.safetensors"


class Encoder(Protocol):
    """Anything that makes a smaller observation of an observation."""

    @property
    def latent_size(self) -> int:
        """Number of latents."""

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size) of observations (..., dim(O)), same kind."""


class KeptEncoder:
    """A trained encoder as it is kept: a kind, its weights and the scaling of its inputs."""

    def __init__(
        self, kind: Kind, weights: dict[str, NDArray[np.float32]], scaling: Scaling, latents: int
    ) -> None:
        """Puts the parts together.

        Raises:
            ValueError: if they do not belong together.
        """
        self._kind, self._weights, self._latents = kind, weights, latents
        self._gain, self._offset = scaling.gain_and_offset()
        self._on: dict[tuple[torch.dtype, torch.device], tuple[dict[str, Tensor], Tensor, Tensor]]
        self._on = {}
        size = len(scaling.minimum)
        if not all(np.isfinite(value).all() for value in weights.values()):
            raise ValueError("weights that are no numbers")
        found = self.encode(np.zeros((1, size), np.float32)).shape
        back = np.shape(kind.decode(weights, np.zeros((1, latents), np.float32)))
        if found != (1, latents) or back != (1, size):
            raise ValueError(f"weights of {found[-1]} latents, not of {latents}")

    @classmethod
    def from_files(cls, description: dict[str, Any], weights: bytes) -> "KeptEncoder":
        """Reads an encoder as it is kept.

        Args:
            description: its JSON, with its kind and the input scaling.
            weights: its safetensors.

        Raises:
            ValueError, KeyError, TypeError: if the two are no encoder, or don't belong together.
        """
        try:
            tensors = {
                name: np.asarray(value, np.float32)
                for name, value in safetensors.numpy.load(weights).items()
            }
        except safetensors.SafetensorError as error:
            raise ValueError(f"no safetensors: {error}") from None
        size, latents = len(description["features"]), description["latents"]
        extremes = [np.array(description[end], np.float32) for end in ("minimum", "maximum")]
        if any(extreme.shape != (size,) for extreme in extremes):
            raise ValueError("a scaling of another size")
        if not isinstance(latents, int) or latents < 1:
            raise ValueError(f"{latents} latents")
        # The first version of jbench kept no options: they are of the training alone.
        kind = make_kind(description["kind"], description.get("options", {}))
        return cls(kind, tensors, Scaling(*extremes), latents)

    @property
    def latent_size(self) -> int:
        """Number of latents."""
        return self._latents

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size) of observations (..., dim(O)).

        Arrays of numpy are encoded in float32, those of torch in their own precision and on their
        own device.
        """
        if isinstance(batch, Tensor):
            weights, gain, offset = self._torch(batch.dtype, batch.device)
            return self._kind.encode(weights, batch * gain + offset)
        scaled = np.asarray(batch, np.float32) * self._gain + self._offset
        return self._kind.encode(self._weights, scaled)

    def _torch(
        self, dtype: torch.dtype, device: torch.device
    ) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """Returns the weights and the scaling as tensors, made once for each kind of batch."""
        if (dtype, device) not in self._on:

            def tensor(value: NDArray[np.float32]) -> Tensor:
                return torch.from_numpy(value).to(device, dtype)

            weights = {name: tensor(value) for name, value in self._weights.items()}
            self._on[dtype, device] = weights, tensor(self._gain), tensor(self._offset)
        return self._on[dtype, device]


def load_encoder(results: Results, id: str) -> tuple[Encoder, dict[str, Any]]:
    """Returns a finished encoder by its id, and its description.

    Raises:
        RequestError: if there is none of that id, or it is unfinished.
        WorkError: if its files are damaged or no encoder.
    """
    record = results.find("encoder", id)
    if record is None:
        there = [record.id for record in results.scan("encoder")[0]]
        raise RequestError(
            f"No encoder {id} in {results.path}; "
            + (f"there are {', '.join(there)}." if there else "there is none yet: run jbench ")
            + ("" if there else "train-dae.")
        )
    if record.status != "finished":
        raise RequestError(
            f"The encoder {id} is unfinished; type the command that began it again and it "
            "continues."
        )
    try:
        description = json.loads(record.read_file(DESCRIPTION))
        return KeptEncoder.from_files(description, record.read_file(WEIGHTS)), description
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise WorkError(f"The encoder {id} can't be read ({error}); train it again.") from None


def find_encoder(results: Results, wanted: str, task: str) -> str:
    """Returns the id of the encoder that a user means, for a task.

    Args:
        results: where to look.
        wanted: KIND:LATENTS, for the newest encoder of that kind and size trained on this task and
            on the plain robot; KIND alone where the task determines the size; a number of latents
            alone, for a denoising autoencoder; or an encoder's id.
        task: that the agent will learn.

    Raises:
        RequestError: if there is none, or it is one for another task's observations.
    """
    kind, colon, number = wanted.rpartition(":")
    if wanted in kind_names():
        kind, colon, number = wanted, ":", _only_size(wanted, task)
    if not colon and not wanted.isdecimal():
        _, description = load_encoder(results, wanted)
        if description["task"] != task:
            raise RequestError(
                f"The encoder {wanted} is for {description['task']}, not for {task}; type "
                f"{_command(description['kind'], task)} to make one."
            )
        return wanted
    kind = known("kind of encoder", kind, kind_names()) if colon else "dae"
    latents = int(number) if number.isdecimal() else 0
    _check_size(kind, latents, task)
    fitting = [
        record
        for record in results.scan("encoder")[0]
        if _fits(record, kind, task, latents) and _of_plain_robot(results, record)
    ]
    if not fitting:
        raise RequestError(
            f"No {kind} of {latents} latents for {task} in {results.path}; type "
            f"{_command(kind, task, latents)} to make one."
        )
    return max(fitting, key=lambda record: record.manifest.updated).id


def _only_size(kind: str, task: str) -> str:
    """Returns the number of latents of a kind that has one size for a task.

    Raises:
        RequestError: if it has several.
    """
    sizes = find_kind(kind).latent_sizes(task)
    if len(sizes) > 1:
        raise RequestError(
            f"Encoders of the kind {kind} have {sizes[0]} to {sizes[-1]} latents on {task}; type "
            f"--encoder {kind}:12, or another number."
        )
    return str(sizes[0])


def _check_size(kind: str, latents: int, task: str) -> None:
    """Refuses a number of latents that no encoder of a kind can have for a task."""
    sizes = find_kind(kind).latent_sizes(task)
    if latents in sizes:
        return
    if len(sizes) == 1:
        raise RequestError(f"{kind} of {task} has {sizes[0]} latents; type --encoder {kind}.")
    raise RequestError(
        f"An encoder of {task} has {sizes[0]} to {sizes[-1]} latents, if it is of the kind {kind}; "
        f"type --encoder with such a number, as 12 or {kind}:12, or none."
    )


def _command(kind: str, task: str, latents: int | None = None) -> str:
    """Returns what to type for an encoder of a kind; its size is left out where it has only one."""
    verb = "train-dae" if kind == "dae" else f"train-encoder --kind {kind}"
    size = "" if latents is None else f" --latent {latents}"
    if size and len(find_kind(kind).latent_sizes(task)) == 1:
        size = ""
    return f"jbench {verb} --task {task}{size}"


def _of_plain_robot(results: Results, record: Record) -> bool:
    """Returns whether an encoder's dataset is of the plain robot, as far as is known."""
    try:
        dataset = results.find("dataset", str(record.settings.get("dataset")))
    except (RequestError, WorkError):
        return True
    return dataset is None or dataset.settings.get("augment") is None


def _fits(record: Record, kind: str, task: str, latents: int) -> bool:
    settings = record.settings
    return record.status == "finished" and (
        (settings.get("kind"), settings.get("task"), settings.get("latents"))
        == (kind, task, latents)
    )
