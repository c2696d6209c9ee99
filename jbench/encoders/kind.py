"""What a kind of encoder is: the base classes `Kind`, `Fitted` and `Learned`.

A kind is a class whose fields are its options and whose methods are pure functions of named
weights. Learned kinds are trained by the loop in `loop.py`, the others are fitted to the states.
`docs/your-own-encoder.md` explains how to add a kind in another package.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, field_validator
from torch import Tensor

from jbench.arrays import Array
from jbench.encoders.networks import Weights, affine, layers, standard_normal, tanh
from jbench.encoders.pairs import StatePairs, state_pairs
from jbench.encoders.scaling import Moments
from jbench.encoders.states import Scale, States
from jbench.names import EncoderBase
from jbench.settings.base import Settings, omissible

__all__ = ["Fitted", "Kind", "Learned", "Weights", "affine", "layers", "standard_normal", "tanh"]
"""What the kinds of other packages import from here."""


class Kind(Settings):
    """Base class of all kinds. The fields of a kind are its options and enter the encoder's id.

    A kind implements `encode` and `decode`. Callers use `to_latents` and `from_latents`, which
    also apply the option `rescale`.

    Attributes:
        uses_actions: whether its training needs the actions and rewards between two states.
        needs_all_features: whether it refuses the option `features`.
        bases: options by the name of their source.
        decodes_later: whether `decode` returns the state `steps_ahead` control steps later.
        is_rowwise: whether a row has the same latents, bit for bit, in every batch. That is so if
            `encode` has no matrix product, which may round differently in a larger batch.
    """

    uses_actions: ClassVar[bool] = False
    needs_all_features: ClassVar[bool] = False
    bases: ClassVar[Mapping[EncoderBase, Mapping[str, Any]]] = {}
    decodes_later: ClassVar[bool] = False
    is_rowwise: ClassVar[bool] = False

    features: list[str] | None = omissible(
        None,
        description="what it encodes of the observation, by name, as in "
        "position,velocity_angular_z; a minus leaves one out, as in -speed_in_target_frame; ours: "
        "all features by default",
    )
    scale: Scale = omissible(
        "dataset",
        description="scale of the inputs: extremes over the dataset to [-1, 1] (dataset), the "
        "observation as it is (observation), or unit variance (sd); authors' script, their last "
        "environment, and ours",
    )
    rescale: Literal["whitened", "standardized", "extremes"] | None = omissible(
        None,
        description="scale of the latents over the dataset: mean 0 and every principal direction "
        "to a standard deviation of 1/3 (whitened), mean 0 and every latent to a standard "
        "deviation of 1 (standardized), or extremes to [-1, 1] (extremes); ours",
    )

    @field_validator("features", mode="before")
    @classmethod
    def _separated(cls, value: Any) -> Any:
        """Separates the names of a text such as position,velocity_angular_z."""
        if isinstance(value, str):
            return [name.strip() for name in value.split(",")]
        return value

    @property
    def steps_ahead(self) -> int:
        """Control steps from `StatePairs.now` to `later`: the option `horizon`, if any, or 0."""
        return int(getattr(self, "horizon", None) or 0)

    def latent_sizes(self, task: str, features: int) -> range:
        """Returns the allowed numbers of latents, by default 1 to the number of features.

        A kind whose size is determined by the task returns a range of one number.

        Args:
            task: name of the task.
            features: number of those that the kind gets of the task's observation.
        """
        return range(1, features + 1)

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns latents (..., latents) for scaled states (..., size), of the same array type."""
        raise NotImplementedError

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns scaled states (..., size) for latents (..., latents), of the same array type."""
        raise NotImplementedError

    def to_latents(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents (..., latents) of an encoder; see `encode`."""
        latents = self.encode(weights, scaled)
        if self.rescale is None:
            return latents
        return (latents - weights["rescale.center"]) @ weights["rescale.matrix"].T

    def from_latents(self, weights: Weights, latents: Array) -> Array:
        """Returns the decoded states (..., size) of an encoder's latents; see `decode`."""
        if self.rescale is not None:
            latents = latents @ weights["rescale.inverse"].T + weights["rescale.center"]
        return self.decode(weights, latents)

    def action_signs(self, weights: Weights, scaled: Array) -> Array | None:
        """Returns what the action of a policy on the latents is multiplied by for the robot.

        A kind that encodes the mirror image of some states returns (..., 1), -1 for those states
        and 1 for the others; None, the default, means 1 for all.
        """
        return None

    def summary(self, weights: Weights) -> dict[str, Any]:
        """Returns entries for the summary of an encoder's manifest; empty by default."""
        return {}


class Fitted(Kind):
    """A kind whose weights, if any, are computed from the states, without a training loop.

    Hand-made numbers need only `encode`. Without `decode`, states are reconstructed from latents by
    linear regression.
    """

    def latent_sizes(self, task: str, features: int) -> range:
        """Returns the number of latents of `encode`, or if it needs weights the default."""
        if type(self).fit is not Fitted.fit:
            return super().latent_sizes(task, features)
        size = np.shape(self.encode({}, np.zeros((1, features), np.float32)))[-1]
        return range(size, size + 1)

    def fit(self, states: States, latents: int) -> dict[str, NDArray[Any]]:
        """Returns the weights; `states` have been read, and have the moments `learned`."""
        return {}

    def decode(self, weights: Weights, latents: Array) -> Array:
        """Returns the scaled states (..., size) that linear regression predicts from latents."""
        return latents @ weights["decoder.slopes"] + weights["decoder.offset"]

    @property
    def is_regressed(self) -> bool:
        """Whether `decode` is the linear regression, whose weights `linear_decoder` returns."""
        return type(self).decode is Fitted.decode

    def linear_decoder(self, weights: Weights, states: States) -> dict[str, NDArray[Any]]:
        """Returns the weights of the linear regression of the training states on the latents."""
        moments: Moments | None = None
        for batch in state_pairs(states.learn(), 0):
            scaled = batch.now.cpu().numpy()
            latents = np.asarray(self.encode(weights, scaled), np.float32)
            some = Moments.of(np.hstack([latents, scaled]))
            moments = some if moments is None else moments.merged(some)

        assert moments is not None
        slopes, offset = moments.regression(len(moments.mean) - states.size)
        return {"decoder.slopes": slopes, "decoder.offset": offset}


class Learned(Kind):
    """A kind whose weights are trained by Adam."""

    epochs: int = Field(default=200, ge=1, description="passes over the states; authors' script")
    batch: int = Field(default=8192, ge=1, description="rows in a step; authors' script")
    learning_rate: float = Field(
        default=1e-3,
        gt=0,
        description="step size of Adam; paper, section 5.2: its default (script: 5e-4)",
    )

    def initial(self, size: int, latents: int, random: torch.Generator) -> dict[str, Tensor]:
        """Returns initial weights by name, drawn on the CPU.

        A kind that uses the actions of robots with several actuators takes `action_size`, too.
        """
        raise NotImplementedError

    def constants(self, states: States) -> dict[str, Tensor]:
        """Returns weights that are computed before training and stay fixed.

        They are on the device of the states and are passed to the methods with the other weights.
        """
        return {}

    def prepare(self, batch: StatePairs, latents: int, random: torch.Generator) -> StatePairs:
        """Returns a batch with the noise of an epoch added; see `StatePairs`.

        The batch is on the training device and the generator on the CPU: use `standard_normal`.
        """
        return batch

    def loss(self, weights: Weights, batch: StatePairs) -> Tensor:
        """Returns the loss, a mean over the rows of a prepared batch."""
        raise NotImplementedError

    def gradient(
        self, weights: Mapping[str, Tensor], gradients: Mapping[str, Tensor], batch: StatePairs
    ) -> Tensor:
        """Writes the gradient of the loss to `gradients`, by name of the weight; returns the loss.

        A kind may override this with a faster implementation that equals autograd.
        """
        loss = self.loss(weights, batch)
        trained = [weights[name] for name in gradients]
        values = torch.autograd.grad(loss, trained, materialize_grads=True)  # 0 if unused
        for gradient, value in zip(gradients.values(), values, strict=True):
            gradient.copy_(value)
        return loss.detach()
