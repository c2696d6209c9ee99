"""The encoder protocol, saved encoders, and finding them in the results."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import safetensors
import safetensors.numpy
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Kind, Weights
from jbench.encoders.registry import (
    SCALES,
    Wanted,
    make_kind,
    only_size,
    representation,
    wanted_encoder,
)
from jbench.encoders.scaling import Scaling
from jbench.encoders.settings import EncoderSettings
from jbench.errors import RequestError, WorkError
from jbench.names import one_of
from jbench.simulation import find_task
from jbench.store import Record, Results
from jbench.store.shipped import results_to_read
from jbench.tasks.features import Array
from jbench.wording import with_results

DESCRIPTION = "encoder.json"
WEIGHTS = "encoder.safetensors"


class Encoder(Protocol):
    """Maps observations to latents."""

    @property
    def latent_size(self) -> int:
        """Number of latents."""

    def encode(self, batch: Array) -> Array:
        """Returns latents (..., latent_size) for observations (..., dim(O)), same array type."""


class SavedEncoder:
    """A trained encoder: a kind, its weights and the scaling of its inputs."""

    def __init__(
        self, kind: Kind, weights: dict[str, NDArray[np.float32]], scaling: Scaling, latents: int
    ) -> None:
        """Makes the encoder.

        Raises:
            ValueError: if the weights are not finite or have other sizes.
        """
        self._kind, self._weights, self._latents = kind, weights, latents
        self._gain, self._offset = scaling.gain_and_offset()
        self._tensors: dict[
            tuple[torch.dtype, torch.device], tuple[dict[str, Tensor], Tensor, Tensor]
        ] = {}
        size = len(scaling.minimum)
        if not all(np.isfinite(value).all() for value in weights.values()):
            raise ValueError("weights that are not finite")
        encoded = np.shape(self.encode(np.zeros((1, size), np.float32)))
        if encoded != (1, latents):
            raise ValueError(f"encode returns the shape {encoded}, not {(1, latents)}")
        decoded = np.shape(kind.from_latents(weights, np.zeros((1, latents), np.float32)))
        if decoded != (1, size):
            raise ValueError(f"decode returns the shape {decoded}, not {(1, size)}")

    @classmethod
    def from_files(cls, description: dict[str, Any], weights: bytes) -> "SavedEncoder":
        """Reads an encoder from its JSON description and its safetensors.

        Raises:
            ValueError, KeyError, TypeError: if they are invalid or do not match.
        """
        try:
            tensors = {
                name: np.asarray(value, np.float32)
                for name, value in safetensors.numpy.load(weights).items()
            }
        except safetensors.SafetensorError as error:
            raise ValueError(f"not a safetensors file: {error}") from None
        size, latents = len(description["features"]), description["latents"]
        extremes = [np.array(description[name], np.float32) for name in ("minimum", "maximum")]
        if any(extreme.shape != (size,) for extreme in extremes):
            raise ValueError("a scaling of another size")
        if not isinstance(latents, int) or latents < 1:
            raise ValueError(f"{latents} latents")
        # Version 1 did not save options, which affected only the training.
        kind = make_kind(description["kind"], description.get("options", {}))
        return cls(kind, tensors, Scaling(*extremes), latents)

    @property
    def latent_size(self) -> int:
        """Number of latents."""
        return self._latents

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size) of observations (..., dim(O)).

        Numpy arrays are encoded in float32, torch tensors in their own precision on their device.
        """
        return self._kind.to_latents(*self._scaled(batch))

    def action_signs(self, batch: Array) -> Array | None:
        """Returns the signs of the actions for observations (..., dim(O)); see `action_signs`."""
        return self._kind.action_signs(*self._scaled(batch))

    def _scaled(self, batch: Array) -> tuple[Weights, Array]:
        """Returns the weights and the scaled observations, of the same array type."""
        if isinstance(batch, Tensor):
            weights, gain, offset = self._torch(batch.dtype, batch.device)
            return weights, batch * gain + offset
        return self._weights, batch.astype(np.float32, copy=False) * self._gain + self._offset

    def _torch(
        self, dtype: torch.dtype, device: torch.device
    ) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """Returns the weights and the scaling as tensors, cached per dtype and device."""
        if (dtype, device) not in self._tensors:

            def tensor(value: NDArray[np.float32]) -> Tensor:
                return torch.from_numpy(value).to(device, dtype)

            weights = {name: tensor(value) for name, value in self._weights.items()}
            self._tensors[dtype, device] = weights, tensor(self._gain), tensor(self._offset)
        return self._tensors[dtype, device]


def action_signs(encoder: Encoder | None, observations: Array) -> Array | None:
    """Returns what the actions of a policy on an encoder's latents are multiplied by for the robot.

    Args:
        encoder: None for the full observation. Only one with a method `action_signs`, such as a
            `SavedEncoder`, can mirror observations.
        observations: (..., dim(O)), not encoded.

    Returns:
        (..., 1), -1 where the encoder encodes the mirror image of the observation and 1 elsewhere;
        None for an encoder that never does.
    """
    method = getattr(encoder, "action_signs", None)
    return None if method is None else method(observations)


def on_observations(encoder: Encoder | None, act: Callable[[Array], Array]) -> Callable[..., Array]:
    """Returns a policy on observations (..., dim(O)), given one on the latents of an encoder."""
    if encoder is None:
        return act

    def act_on_observations(observations: Array) -> Array:
        actions = act(encoder.encode(observations))
        signs = action_signs(encoder, observations)
        return actions if signs is None else actions * signs

    return act_on_observations


def load_encoder(results: Results | Path | str, id: str) -> tuple[Encoder, dict[str, Any]]:
    """Returns a finished encoder and its description.

    Raises:
        RequestError: if the encoder does not exist or is unfinished.
        WorkError: if its files are damaged or invalid.
    """
    results = results_to_read(results)
    record = results.find("encoder", id)
    if record is None:
        ids = [record.id for record in results.scan("encoder")[0]]
        command = with_results("jbench train-dae", results.name)
        there = f"there are {', '.join(ids)}" if ids else f"there is none yet: run {command}"
        raise RequestError(
            f"No encoder {id} in {results.name}; {there}. A kind with a number of latents, such as "
            "dae12, selects the newest one."
        )
    if record.status != "finished":
        raise RequestError(
            f"The encoder {id} is unfinished; type the command that started it to resume it."
        )
    try:
        description = json.loads(record.read_file(DESCRIPTION))
        return SavedEncoder.from_files(description, record.read_file(WEIGHTS)), description
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise WorkError(f"The encoder {id} can't be read ({error}); train it again.") from None


def find_encoder(results: Results | Path | str, name: str, task: str) -> str:
    """Returns the id of an encoder for a task.

    Args:
        name: a representation (see `wanted_encoder`) for its newest encoder trained on this task
            and the plain robot; a number of latents for a denoising autoencoder; or the id of an
            encoder, or the beginning of a single one.

    Raises:
        RequestError: if there is none, or it encodes the observations of another task.
    """
    results = results_to_read(results)
    find_task(task)
    encoder = wanted_encoder(f"dae{name}" if name.isdecimal() else name, task)
    matches = [
        record
        for record in results.scan("encoder")[0]
        if record.status == "finished"
        and record.settings.get("task") == task
        # Only its representation names a kind that was given as MODULE:CLASS.
        and (
            record.path.parent.name == name
            if encoder is None
            else _is_wanted(record.settings, encoder)
        )
        and _of_plain_robot(results, record)
    ]
    if encoder is None and not matches:
        return _find_id(results, name, task)
    if encoder is not None and not matches:
        size = representation(encoder.kind, encoder.latents, encoder.options)
        raise RequestError(
            f"No {size} for {task} in {results.name}; type "
            f"{with_results(_command(encoder.kind, task, encoder), results.name)} to make one."
        )
    return max(matches, key=lambda record: record.manifest.updated).id


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


def _is_wanted(settings: Mapping[str, Any], encoder: Wanted) -> bool:
    """Returns whether recorded settings are of this kind, size and scales."""
    options = settings.get("options", {})
    same = (settings.get("kind"), settings.get("latents")) == (encoder.kind, encoder.latents)
    return same and all(options.get(name) == encoder.options.get(name) for name in SCALES)


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


def _of_plain_robot(results: Results, record: Record) -> bool:
    """Returns whether an encoder's dataset has the plain robot; True if it is unavailable."""
    try:
        dataset = results.find("dataset", str(record.settings.get("dataset")))
    except (RequestError, WorkError):
        return True
    return dataset is None or dataset.settings.get("augment") is None
