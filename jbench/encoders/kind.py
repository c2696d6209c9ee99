"""A kind of encoder: its options, and how it encodes, decodes and learns.

A kind is a class whose fields are its options and whose methods are pure functions of named
weights. Learned kinds are trained by the loop in `loop.py`, closed forms from the data's moments
alone. `docs/encoders.md` says how to add one from a package of your own.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from jbench.encoders.moments import Moments
from jbench.settings.base import Settings
from jbench.tasks.features import TASK_SPECS, Array

if TYPE_CHECKING:
    from jbench.encoders.states import States

Weights = Mapping[str, Any]
"""Named arrays in float32, all of numpy or all of torch."""


class Batch(NamedTuple):
    """Rows to learn from, all features scaled to [-1, 1].

    Attributes:
        now: (rows, size) states to encode, corrupted where the kind does so.
        later: (rows, size) the clean states `steps_ahead` control steps later.
        actions: (rows, steps_ahead) taken from `now` on; None unless the kind uses them.
        noise: (rows, latents) of a kind that draws its latents at random; else None.
        rewards: (rows, steps_ahead) of the actions; None unless the kind uses actions.
    """

    now: Tensor
    later: Tensor
    actions: Tensor | None = None
    noise: Tensor | None = None
    rewards: Tensor | None = None

    def split(self, rows: int) -> list["Batch"]:
        """Returns the batch in parts of this many rows; the last may have fewer."""
        none = [None] * -(-len(self.now) // rows)
        parts = [none if part is None else part.split(rows) for part in self]
        return [Batch(*each) for each in zip(*parts, strict=True)]


class Kind(Settings):
    """What all kinds share. The fields of a kind are its options; they are part of the id.

    Attributes:
        uses_actions: whether it learns from actions too.
        decodes_later: whether `decode` gives the state `steps_ahead` steps later, not the present.
    """

    uses_actions: ClassVar[bool] = False
    decodes_later: ClassVar[bool] = False

    @property
    def steps_ahead(self) -> int:
        """Control steps from `Batch.now` to `Batch.later`."""
        return 0

    @classmethod
    def latent_sizes(cls, task: str) -> range:
        """Returns the numbers of latents that an encoder of a task may have: 1 to its features.

        A kind whose task determines the size returns a range of one number.
        """
        return range(1, TASK_SPECS[task].observation_size + 1)

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents (..., latents) of scaled states (..., size), of the same kind."""
        raise NotImplementedError

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the scaled states (..., size) of latents (..., latents), of the same kind."""
        raise NotImplementedError

    def summary(self, weights: Weights) -> dict[str, Any]:
        """Returns what an encoder's manifest says of its weights, as JSON; by default nothing."""
        return {}


class ClosedForm(Kind):
    """A kind whose weights follow from the moments of the data."""

    def fit(self, moments: Moments, latents: int, seed: int) -> dict[str, NDArray[np.float64]]:
        """Returns the weights.

        Args:
            moments: of the scaled states to learn from.
            latents: how many.
            seed: of what is drawn.
        """
        raise NotImplementedError


class Fitted(Kind):
    """A kind whose weights are computed from the states themselves, without a training loop."""

    def fit(self, states: "States", latents: int) -> dict[str, NDArray[np.float64]]:
        """Returns the weights.

        Args:
            states: to learn from, read.
            latents: how many.
        """
        raise NotImplementedError


class Learned(Kind):
    """A kind whose weights are learned by Adam."""

    epochs: int = Field(default=200, ge=1, description="authors' script")
    batch: int = Field(default=8192, ge=1, description="rows in a step; authors' script")
    learning_rate: float = Field(
        default=1e-3, gt=0, description="Adam's default; paper, section 5.2 (script: 5e-4)"
    )

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns initial weights by name, on the CPU, drawn from the generator, which is there."""
        raise NotImplementedError

    def constants(self, states: "States") -> dict[str, Tensor]:
        """Returns weights that are computed from the states before the training and stay fixed.

        They are on the device of the states, and are among the weights that the methods get.
        """
        return {}

    def prepare(self, batch: Batch, latents: int, random: torch.Generator) -> Batch:
        """Returns a large batch with what is drawn again in each epoch; see `Batch`.

        The batch is on the device that computes, and the generator on the CPU: `standard_normal`
        draws there and moves the numbers to the batch.
        """
        return batch

    def loss(self, weights: Weights, batch: Batch) -> Tensor:
        """Returns what is minimised, the mean over the rows of a prepared batch."""
        raise NotImplementedError

    def gradient(
        self, weights: Mapping[str, Tensor], gradients: Mapping[str, Tensor], batch: Batch
    ) -> Tensor:
        """Puts the gradient of the loss into `gradients`, of the weights' names; returns the loss.

        A kind may do so by hand where that is faster; it must be what autograd gives.
        """
        loss = self.loss(weights, batch)
        found = torch.autograd.grad(loss, [weights[name] for name in gradients])
        for gradient, value in zip(gradients.values(), found, strict=True):
            gradient.copy_(value)
        return loss.detach()


def glorot(outputs: int, inputs: int, random: torch.Generator) -> Tensor:
    """Returns an (outputs, inputs) matrix drawn as Glorot and Bengio (2010) do for tanh layers."""
    limit = (6 / (outputs + inputs)) ** 0.5
    return torch.empty(outputs, inputs).uniform_(-limit, limit, generator=random)


def standard_normal(shape: Sequence[int], random: torch.Generator, like: Tensor) -> Tensor:
    """Returns standard normal numbers of a shape, drawn on the CPU, with the device of `like`."""
    return torch.empty(shape, dtype=like.dtype).normal_(generator=random).to(like.device)


def tanh(values: Array) -> Array:
    """Returns the hyperbolic tangents of an array of numpy or torch."""
    if not isinstance(values, Tensor):
        return np.tanh(values)
    if values.requires_grad and values.device.type == "cpu":
        return _Tanh.apply(values)  # type: ignore[no-untyped-call]
    return values.tanh()


def tanh_(values: Tensor) -> Tensor:
    """Replaces numbers by their hyperbolic tangents; outside of autograd."""
    if values.device.type == "cpu":
        np.tanh(values.numpy(), out=values.numpy())
        return values
    return values.tanh_()


class _Tanh(torch.autograd.Function):
    """Numpy's tanh with its derivative: on one core about ten times as fast as torch's own."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        """Returns the tangents."""
        tangents = torch.from_numpy(np.tanh(values.detach().numpy()))
        ctx.save_for_backward(tangents)
        return tangents

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        """Returns the gradient before the tanh."""
        tangents: Tensor = ctx.saved_tensors[0]
        return gradient * (1 - tangents.square())
