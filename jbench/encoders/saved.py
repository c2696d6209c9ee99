"""The encoder protocol, saved encoders, and agents on their latents."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import safetensors
import safetensors.numpy
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Kind, Weights
from jbench.encoders.registry import make_kind
from jbench.encoders.scaling import Scaling
from jbench.errors import RequestError
from jbench.tasks.features import by_dimension, mirrored, observation_size
from jbench.tasks.geometry import Array

DESCRIPTION = "encoder.json"
WEIGHTS = "encoder.safetensors"

_GAIN, _OFFSET = "observation.gain", "observation.offset"  # of the scaling, beside the weights

_MIRRORED = 64  # random observations from which the mirror of latents is found
_TOLERANCE = 1e-4  # relative to the range of an input; encoders are stored in float32


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
        self._kind, self._latents = kind, latents
        gain, offset = scaling.gain_and_offset()
        self._weights = {**weights, _GAIN: gain, _OFFSET: offset}
        self._tensors: dict[tuple[torch.dtype, torch.device], dict[str, Tensor]] = {}
        size = len(scaling.minimum)
        if not all(np.isfinite(value).all() for value in weights.values()):
            raise ValueError("weights that are not finite")
        encoded = np.shape(self.encode(np.zeros((1, size), np.float32)))
        if encoded != (1, latents):
            raise ValueError(f"encode returns the shape {encoded}, not {(1, latents)}")
        decoded = np.shape(kind.from_latents(self._weights, np.zeros((1, latents), np.float32)))
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
        weights: Weights = self._weights
        if isinstance(batch, Tensor):
            weights = self._in_torch(batch.dtype, batch.device)
        else:
            batch = batch.astype(np.float32, copy=False)
        return weights, batch * weights[_GAIN] + weights[_OFFSET]

    def _in_torch(self, dtype: torch.dtype, device: torch.device) -> dict[str, Tensor]:
        """Returns the weights as tensors, cached per dtype and device."""
        if (dtype, device) not in self._tensors:
            self._tensors[dtype, device] = {
                name: torch.from_numpy(value).to(device, dtype)
                for name, value in self._weights.items()
            }
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


class InputMirror(NamedTuple):
    """An agent's inputs for a mirrored observation are gain * inputs + offset, each (size,)."""

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]


def input_mirror(task: str, encoder: Encoder | None) -> InputMirror:
    """Returns the mirror image of an agent's inputs, for minibatches with mirrored transitions.

    An encoder needs no method for it: the mirror is found by encoding random observations and
    their mirror images. A mirror that acts on each input alone either keeps it or reflects it.

    Args:
        encoder: None for the full observation.

    Raises:
        RequestError: if a mirror mixes its latents, or it encodes mirror images itself.
    """
    if encoder is None:
        signs = np.array(by_dimension(task, "mirror"), np.float64)
        return InputMirror(signs, np.zeros_like(signs))
    shape = _MIRRORED, observation_size(task)
    random = torch.Generator().manual_seed(0)
    observations = 2 * torch.rand(shape, dtype=torch.float64, generator=random) - 1
    if action_signs(encoder, observations) is not None:
        raise RequestError(
            "mirror=true is not for agents on an encoder that mirrors observations itself, such as "
            "planar-mirror: leave it out, or choose planar."
        )
    inputs = encoder.encode(observations)
    images = encoder.encode(mirrored(task, observations))
    keeps = (images - inputs).abs().amax(0) < (images + inputs).var(0).sqrt()
    gain = torch.where(keeps, 1.0, -1.0)
    rest = images - gain * inputs
    offset = torch.where(keeps, 0.0, rest.mean(0))
    width = inputs.amax(0) - inputs.amin(0)
    if bool(((rest - offset).abs().amax(0) > _TOLERANCE * width).any()):
        raise RequestError(
            "mirror=true needs inputs of which a mirror changes only signs, such as those of full, "
            "scaled or planar, and this encoder mixes them: leave it out, or choose one of these."
        )
    return InputMirror(gain.numpy(), offset.numpy())
