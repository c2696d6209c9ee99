"""Adam (Kingma and Ba, 2015, Algorithm 1) without the class of PyTorch, which imports its compiler.

`torch.optim.Adam` imports `torch._dynamo`, which takes seconds, and that imports triton where
PyTorch has CUDA: its LLVM ends the process (SIGSEGV) if MuJoCo has loaded that of Mesa before.
"""

from collections.abc import Sequence

import torch
from torch import Tensor


def fused_step(
    values: list[Tensor],
    gradients: list[Tensor],
    first: list[Tensor],
    second: list[Tensor],
    steps: list[Tensor],
    *,
    learning_rate: float,
    epsilon: float = 1e-8,
) -> None:
    """Makes one step in place, by the kernel of `torch.optim.Adam(fused=True)`.

    Args:
        values: what is trained.
        gradients: of the loss by each of the values.
        first: the moving average of the gradients, for each of the values.
        second: that of their squares.
        steps: the number of steps, this one included, for each of the values.
        learning_rate: of this step.
        epsilon: added to the root of the second moment; by default that of the paper.
    """
    torch._fused_adam_(
        values,
        gradients,
        first,
        second,
        [],
        steps,
        amsgrad=False,
        lr=learning_rate,
        beta1=0.9,
        beta2=0.999,
        weight_decay=0.0,
        eps=epsilon,
        maximize=False,
    )


class FusedAdam:
    """Some values and their moments; see `fused_step`.

    Attributes:
        values: what is trained, in place.
        learning_rate: of the next step.
        first: the moving average of the gradients, for each of the values.
        second: that of their squares.
        steps: the number of steps, for each of the values.
    """

    def __init__(self, values: Sequence[Tensor], learning_rate: float) -> None:
        """Begins without moments; the values are changed in place."""
        self.values = [value.detach() for value in values]
        self.learning_rate = learning_rate
        self.first = [torch.zeros_like(value) for value in self.values]
        self.second = [torch.zeros_like(value) for value in self.values]
        self.steps = [torch.zeros((), device=value.device) for value in self.values]

    def step(self, gradients: Sequence[Tensor]) -> None:
        """Makes one step in place."""
        for steps in self.steps:
            steps += 1

        fused_step(
            self.values,
            list(gradients),
            self.first,
            self.second,
            self.steps,
            learning_rate=self.learning_rate,
        )
