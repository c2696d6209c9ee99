"""Minibatches that encoders are trained on."""

from typing import NamedTuple

from torch import Tensor


class Batch(NamedTuple):
    """Training rows with features scaled to [-1, 1].

    Attributes:
        now: (rows, size) states to encode, corrupted by some kinds.
        later: (rows, size) clean states `steps_ahead` control steps later.
        actions: (rows, steps_ahead) between the two; None unless the kind uses actions.
        noise: (rows, latents) standard normal numbers of kinds with random latents; else None.
        rewards: (rows, steps_ahead) of the actions; None unless the kind uses actions.
    """

    now: Tensor
    later: Tensor
    actions: Tensor | None = None
    noise: Tensor | None = None
    rewards: Tensor | None = None

    def split(self, rows: int) -> list["Batch"]:
        """Returns parts of this many rows; the last one may be smaller."""
        none = [None] * -(-len(self.now) // rows)
        parts = [none if part is None else part.split(rows) for part in self]
        return [Batch(*each) for each in zip(*parts, strict=True)]
