"""The encoder protocol, and saved encoders."""

from typing import Any, Protocol

import numpy as np
import safetensors
import safetensors.numpy
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.encoders.kind import Kind, Weights
from jbench.encoders.registry import make_kind
from jbench.encoders.scaling import Scaling
from jbench.tasks.geometry import Array

DESCRIPTION = "encoder.json"
WEIGHTS = "encoder.safetensors"

_GAIN, _OFFSET = "observation.gain", "observation.offset"  # of the scaling, beside the weights


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
        """Makes the encoder; weights that are not finite or of another size are a ValueError."""
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
        weights: Weights = self._weights
        if isinstance(batch, Tensor):
            weights = self._in_torch(batch.dtype, batch.device)
        else:
            batch = batch.astype(np.float32, copy=False)
        return weights, batch * weights[_GAIN] + weights[_OFFSET]

    def _in_torch(self, dtype: torch.dtype, device: torch.device) -> dict[str, Tensor]:
        if (dtype, device) not in self._tensors:
            self._tensors[dtype, device] = {
                name: torch.from_numpy(value).to(device, dtype)
                for name, value in self._weights.items()
            }
        return self._tensors[dtype, device]
