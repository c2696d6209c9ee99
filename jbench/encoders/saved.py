"""The encoder protocol, and saved encoders."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.arrays import Array
from jbench.encoders.kind import Kind
from jbench.encoders.networks import Weights
from jbench.encoders.scaling import Scaling
from jbench.names import ENCODER_FILES

WEIGHTS, DESCRIPTION = ENCODER_FILES

# Names of the scaling beside the weights.
_GAIN = "observation.gain"
_OFFSET = "observation.offset"


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
        self,
        kind: Kind,
        weights: dict[str, NDArray[np.float32]],
        scaling: Scaling,
        latents: int,
        is_observed: Sequence[bool] | None = None,
    ) -> None:
        """Makes the encoder; weights that are not finite or of another size are a ValueError.

        Args:
            scaling: of the features that the kind encodes, (size,).
            latents: number of latents.
            is_observed: whether each value of an observation is one of these features, (dim(O),);
                None for all.
        """
        self._kind = kind
        self.latent_size = latents
        self._is_observed = is_observed
        if is_observed is not None and all(is_observed):
            self._is_observed = None

        self.is_rowwise = kind.is_rowwise and kind.rescale is None
        gain, offset = scaling.gain_and_offset()
        self._weights = {**weights, _GAIN: gain, _OFFSET: offset}
        self._tensors: dict[tuple[torch.device, torch.dtype], dict[str, Tensor]] = {}
        self._columns: dict[torch.device, Tensor] = {}
        size = len(scaling.minimum)
        if not all(np.isfinite(value).all() for value in weights.values()):
            raise ValueError("weights that are not finite")

        scaled = np.zeros((1, size), np.float32) * gain + offset
        encoded = np.shape(kind.to_latents(self._weights, scaled))
        if encoded != (1, latents):
            raise ValueError(f"encode returns the shape {encoded}, not {(1, latents)}")

        decoded = np.shape(kind.from_latents(self._weights, np.zeros((1, latents), np.float32)))
        if decoded != (1, size):
            raise ValueError(f"decode returns the shape {decoded}, not {(1, size)}")

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size) of observations (..., dim(O)).

        Numpy arrays are encoded in float32, torch tensors in their own precision on their device.
        """
        return self._kind.to_latents(*self._scaled(batch))

    def action_signs(self, batch: Array) -> Array | None:
        """Returns the signs of the actions for observations (..., dim(O)); see `action_signs`."""
        return self._kind.action_signs(*self._scaled(batch))

    def _scaled(self, batch: Array) -> tuple[Weights, Array]:
        """Returns the weights in the type of a batch, and the scaled batch."""
        weights: Weights = self._weights
        if isinstance(batch, Tensor):
            kept = self._tensors
            about = (batch.device, batch.dtype)
            if about not in kept:
                kept[about] = {
                    name: torch.from_numpy(array).to(*about) for name, array in weights.items()
                }
            weights = kept[about]
        else:
            batch = batch.astype(np.float32, copy=False)

        return weights, self._features(batch) * weights[_GAIN] + weights[_OFFSET]

    def _features(self, batch: Array) -> Array:
        """Returns the features (..., size) of observations (..., dim(O)) that the kind encodes."""
        if self._is_observed is None:
            return batch
        if batch.shape[-1] != len(self._is_observed):
            size = len(self._is_observed)
            raise ValueError(f"observations of {batch.shape[-1]} numbers instead of {size}")

        columns = np.flatnonzero(self._is_observed)
        if not isinstance(batch, Tensor):
            return batch[..., columns]
        if batch.device not in self._columns:
            self._columns[batch.device] = torch.from_numpy(columns).to(batch.device)

        return batch.index_select(-1, self._columns[batch.device])
