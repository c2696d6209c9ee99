"""Adam for the parameters of several seeds' agents."""

from functools import partial

import torch
from torch import Tensor

from jbench.agents.batched.tensors import Tensors
from jbench.encoders.adam import fused_step


class Adam:
    """Adam over flat parameters (..., count) of one seed or of a stack, and their gradient.

    `name` is the prefix of the saved tensors.
    """

    def __init__(
        self,
        view: Tensors,
        name: str,
        values: Tensor,
        gradient: Tensor,
        learning_rate: float,
        epsilon: float = 1e-8,
    ) -> None:
        count = values.shape[-1]
        first = view.state(f"{name}.first_moment", count)
        second = view.state(f"{name}.second_moment", count)
        self.steps = view.state(f"{name}.steps", dtype=torch.float32)
        # All seeds of a stack have made the same number of steps.
        steps = self.steps if self.steps.ndim == 0 else self.steps[0]
        # Without the bookkeeping of torch's optimizer, which takes as long as the kernel.
        self._update = partial(
            fused_step,
            [values],
            [gradient],
            [first],
            [second],
            [steps],
            learning_rate=learning_rate,
            epsilon=epsilon,
        )

    def step(self) -> None:
        """Makes one step in place."""
        self.steps += 1
        self._update()
