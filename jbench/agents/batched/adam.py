"""Adam for the parameters of several seeds' agents."""

from functools import partial

import torch
from torch import Tensor

from jbench.agents.batched.tensors import Tensors


class Adam:
    """Adam over flat parameters (..., count) of one seed or of a stack, and their gradient.

    Source: Kingma and Ba (2015), Algorithm 1. `name` is the prefix of the saved tensors.
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
        # The kernel of torch.optim.Adam(fused=True) without the optimizer's bookkeeping, which
        # takes as long as the kernel.
        self._update = partial(
            torch._fused_adam_,
            [values],
            [gradient],
            [first],
            [second],
            [],
            [steps],
            amsgrad=False,
            lr=learning_rate,
            beta1=0.9,
            beta2=0.999,
            weight_decay=0.0,
            eps=epsilon,
            maximize=False,
        )

    def step(self) -> None:
        """Makes one step in place."""
        self.steps += 1
        self._update()
