"""Independent random generators of each seed, one per purpose."""

from typing import Any

import numpy as np
import torch
from numpy.random import PCG64, Generator, SeedSequence


class Generators:
    """The generators of one seed, independent of the other seeds.

    They are on the CPU for every device, so an agent on a GPU sees the same robots, minibatches
    and noise as on a CPU.

    Attributes:
        seed: non-negative.
        actions: for exploration.
        updates: for minibatches and noise in updates.
        environments: for initial states, one per environment.
    """

    def __init__(self, seed: int, environments: int) -> None:
        """Seeds the generators."""
        self.seed = seed
        weights, actions, updates, *others = SeedSequence(seed).spawn(3 + environments)
        self._weights = weights
        self.actions, self.updates = Generator(PCG64(actions)), Generator(PCG64(updates))
        self.environments = [Generator(PCG64(other)) for other in others]

    def weights(self) -> torch.Generator:
        """Returns a new generator of the initial weights."""
        return torch.Generator().manual_seed(int(self._weights.generate_state(1, np.uint64)[0]))

    def state(self) -> list[dict[str, Any]]:
        """Returns the state of every generator, serialisable as JSON."""
        return [dict(generator.bit_generator.state) for generator in self._all()]

    def restore(self, state: list[dict[str, Any]]) -> None:
        """Restores what `state` returned."""
        for generator, saved in zip(self._all(), state, strict=True):
            generator.bit_generator.state = saved

    def _all(self) -> list[Generator]:
        return [self.actions, self.updates, *self.environments]
