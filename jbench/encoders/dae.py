"""The paper's denoising autoencoder (paper, section 5.2; Vincent et al., 2008).

One tanh layer to the latent and one back. Its inputs are scaled to [-1, 1] by each feature's
extremes over the dataset and corrupted with Gaussian noise; it learns to give back the clean ones.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import safetensors.torch
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from jbench.tasks.features import Array


@dataclass(frozen=True)
class Scaling:
    """Maps each feature of an observation from its extremes over a dataset to [-1, 1].

    Attributes:
        minimum: (dim(O),) of each feature.
        maximum: (dim(O),) of each feature.
    """

    minimum: NDArray[np.float32]
    maximum: NDArray[np.float32]

    @classmethod
    def of(cls, observations: NDArray[np.float32]) -> "Scaling":
        """Returns the scaling of a dataset (..., dim(O))."""
        rows = observations.reshape(-1, observations.shape[-1])
        return cls(rows.min(axis=0), rows.max(axis=0))

    def gain_and_offset(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns (dim(O),) numbers such that scaled = gain * observation + offset.

        A feature that changes by no more than float32 can tell has nothing to say: it becomes 0.
        """
        low, high = self.minimum.astype(np.float64), self.maximum.astype(np.float64)
        width = high - low
        changes = width > 1e-5 * np.maximum(np.abs(low), np.abs(high))
        gain = np.divide(2, width, out=np.zeros_like(width), where=changes)
        offset = np.where(changes, -1 - gain * low, 0)
        return gain.astype(np.float32), offset.astype(np.float32)


class DenoisingAutoencoder(nn.Module):
    """One fully connected tanh layer to the latent, and one back (paper, Figure 6)."""

    def __init__(self, size: int, latents: int, generator: torch.Generator) -> None:
        """Draws the weights as Glorot and Bengio (2010), with biases of 0.

        Args:
            size: number of features.
            latents: number of latents.
            generator: of the random weights.
        """
        super().__init__()
        # Without their own first draw, which would come from the global generator.
        self.encoder = nn.utils.skip_init(nn.Linear, size, latents)
        self.decoder = nn.utils.skip_init(nn.Linear, latents, size)
        for layer in (self.encoder, self.decoder):
            nn.init.xavier_uniform_(layer.weight, generator=generator)
            nn.init.zeros_(layer.bias)

    def forward(self, scaled: Tensor) -> Tensor:
        """Returns the reconstruction (rows, size) of scaled features (rows, size)."""
        return torch.tanh(self.decoder(torch.tanh(self.encoder(scaled))))


class TanhEncoder:
    """The trained encoder: tanh of an affine map of the observation."""

    def __init__(self, weight: Tensor, bias: Tensor, scaling: Scaling) -> None:
        """Folds the input scaling into the weights (latents, dim(O)) and bias (latents,)."""
        gain, offset = (torch.from_numpy(part) for part in scaling.gain_and_offset())
        self._weight = (weight * gain).T.contiguous()
        self._bias = bias + weight @ offset
        self._numpy = (self._weight.numpy(), self._bias.numpy())

    @classmethod
    def from_files(cls, description: dict[str, Any], weights: bytes) -> "TanhEncoder":
        """Reads an encoder as it is kept.

        Args:
            description: its JSON, with the input scaling.
            weights: its safetensors.

        Raises:
            ValueError, KeyError: if the two are no encoder, or do not belong together.
        """
        try:
            tensors = safetensors.torch.load(weights)
        except safetensors.SafetensorError as error:
            raise ValueError(f"no safetensors: {error}") from None
        scaling = Scaling(
            *(np.array(description[end], np.float32) for end in ("minimum", "maximum"))
        )
        weight, bias = tensors["encoder.weight"], tensors["encoder.bias"]
        latents, size = description["latents"], len(description["features"])
        if weight.shape != (latents, size) or bias.shape != (latents,):
            raise ValueError(
                f"weights {tuple(weight.shape)} for {size} features, {latents} latents"
            )
        if scaling.minimum.shape != (size,) or scaling.maximum.shape != (size,):
            raise ValueError("a scaling of another size")
        return cls(weight, bias, scaling)

    @property
    def latent_size(self) -> int:
        """Number of latents."""
        return len(self._bias)

    def encode(self, batch: Array) -> Array:
        """Returns the latents (..., latent_size), in (-1, 1), of observations (..., dim(O))."""
        if isinstance(batch, Tensor):
            weight, bias = (part.to(batch) for part in (self._weight, self._bias))
            return torch.tanh(batch @ weight + bias)
        matrix, shift = self._numpy
        return np.tanh(np.asarray(batch, np.float32) @ matrix + shift)


class Training(NamedTuple):
    """A trained autoencoder.

    Attributes:
        model: the network.
        scaling: of its inputs.
        epochs: a row for each epoch: its number, errors and wall time.
        feature_errors: (dim(O),) mean squared error of each scaled feature on the test rows.
        feature_variances: (dim(O),) variance of each scaled feature on the test rows.
    """

    model: DenoisingAutoencoder
    scaling: Scaling
    epochs: list[dict[str, float]]
    feature_errors: NDArray[np.float64]
    feature_variances: NDArray[np.float64]


def train(
    train_rows: NDArray[np.float32],
    test_rows: NDArray[np.float32],
    *,
    latents: int,
    noise: float,
    epochs: int,
    batch: int,
    learning_rate: float,
    seed: int,
    progress: Callable[[int], None] = lambda epoch: None,
) -> Training:
    """Trains a denoising autoencoder with Adam on the mean squared error (paper, equation 1).

    Args:
        train_rows: (rows, dim(O)) observations to learn from.
        test_rows: (rows, dim(O)) held-out observations.
        latents: size of the latent.
        noise: standard deviation of the noise on each scaled feature.
        epochs: passes over the rows.
        batch: rows in a step.
        learning_rate: of Adam, whose other settings are the defaults.
        seed: of weights, order and noise.
        progress: called with the number of epochs done.
    """
    began = time.perf_counter()
    generator = torch.Generator().manual_seed(seed)
    scaling = Scaling.of(np.stack([_extremes(train_rows), _extremes(test_rows)]))
    gain, offset = (torch.from_numpy(part) for part in scaling.gain_and_offset())
    learn, test = (torch.from_numpy(rows) * gain + offset for rows in (train_rows, test_rows))
    model = DenoisingAutoencoder(train_rows.shape[1], latents, generator)
    optimizer = torch.optim.Adam(model.parameters(), lr=learning_rate, fused=True)
    # One corruption of the test rows for all epochs, so that their errors can be compared.
    corrupted_test = test + noise * torch.randn(test.shape, generator=generator)
    history: list[dict[str, float]] = []
    for epoch in range(1, epochs + 1):
        error = _epoch(model, optimizer, learn, noise, batch, generator)
        history.append(
            {
                "epoch": epoch,
                "train_mse": error,
                "test_mse": float(_errors(model, test, test).mean()),
                "test_denoising_mse": float(_errors(model, corrupted_test, test).mean()),
                "wall_time": time.perf_counter() - began,
            }
        )
        progress(epoch)
    variances = test.double().var(dim=0, correction=0).numpy()
    return Training(model, scaling, history, _errors(model, test, test).numpy(), variances)


def _epoch(
    model: DenoisingAutoencoder,
    optimizer: torch.optim.Optimizer,
    rows: Tensor,
    noise: float,
    batch: int,
    generator: torch.Generator,
) -> float:
    """Learns from every row once, in random order; returns the mean error on the way."""
    total = torch.zeros((), dtype=torch.float64)
    for chosen in torch.randperm(len(rows), generator=generator).split(batch):
        clean = rows[chosen]
        corrupted = clean + noise * torch.randn(clean.shape, generator=generator)
        loss = nn.functional.mse_loss(model(corrupted), clean)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        total += loss.detach() * len(chosen)
    return float(total) / len(rows)


@torch.no_grad()
def _errors(model: DenoisingAutoencoder, given: Tensor, wanted: Tensor) -> Tensor:
    """Returns the (dim(O),) mean squared error of each feature, summed in float64."""
    total = torch.zeros(wanted.shape[1], dtype=torch.float64)
    for inputs, outputs in zip(given.split(65536), wanted.split(65536), strict=True):
        total += (model(inputs) - outputs).square().sum(dim=0, dtype=torch.float64)
    return total / len(wanted)


def _extremes(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (2, dim(O)): minimum and maximum of each feature."""
    return np.stack([rows.min(axis=0), rows.max(axis=0)])
