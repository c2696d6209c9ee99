"""The random numbers of one seed, each use with a generator of its own."""

from typing import Any

import numpy as np
import torch
from numpy.random import PCG64, Generator, SeedSequence


class Streams:
    """The generators of one seed; what others draw, or how many seeds there are, is nothing to it.

    All are on the CPU, for every device: an agent on a GPU sees the same robots, minibatches and
    noise, and differs by rounding alone.

    Attributes:
        actions: for exploring.
        updates: for minibatches, and the noise in updates.
        environments: for the beginnings of episodes, one for each environment.
    """

    def __init__(self, seed: int, environments: int) -> None:
        """Begins the streams of a seed.

        Args:
            seed: any number from 0.
            environments: how many it has.
        """
        weights, actions, updates, *others = SeedSequence(seed).spawn(3 + environments)
        self._weights = weights
        self.actions, self.updates = Generator(PCG64(actions)), Generator(PCG64(updates))
        self.environments = [Generator(PCG64(other)) for other in others]

    def weights(self) -> torch.Generator:
        """Returns a new generator of the first weights."""
        return torch.Generator().manual_seed(int(self._weights.generate_state(1, np.uint64)[0]))

    def state(self) -> list[dict[str, Any]]:
        """Returns where every generator is, as JSON can have it."""
        return [dict(generator.bit_generator.state) for generator in self._all()]

    def restore(self, state: list[dict[str, Any]]) -> None:
        """Puts every generator where `state` found it."""
        for generator, where in zip(self._all(), state, strict=True):
            generator.bit_generator.state = where

    def _all(self) -> list[Generator]:
        return [self.actions, self.updates, *self.environments]
