"""Adam over the flat parameters of one seed or of a stack (Kingma and Ba, 2015, Algorithm 1)."""

import torch
from torch import Tensor

from jbench.agents.batched.tensors import SeedView

_BETA1, _BETA2 = 0.9, 0.999


class Adam:
    """Adam for one flat vector of parameters.

    Attributes:
        steps: (...,) number of steps made, float32.
    """

    def __init__(
        self,
        view: SeedView,
        name: str,
        values: Tensor,
        gradient: Tensor,
        learning_rate: float,
        epsilon: float = 1e-8,
    ) -> None:
        """Refers to parameters and their gradient, both (..., count), without copying them.

        Args:
            name: prefix of the saved tensors.
            epsilon: added to the root of the second moment.
        """
        self._first = view.saved(f"{name}.first_moment", values.shape[-1])
        self._second = view.saved(f"{name}.second_moment", values.shape[-1])
        self.steps = view.saved(f"{name}.steps", dtype=torch.float32)
        self._values, self._gradient = values, gradient
        self._learning_rate, self._epsilon = learning_rate, epsilon

    def step(self) -> None:
        """Makes one step in place."""
        self.steps += 1
        # The kernel of torch.optim.Adam(fused=True) without the optimiser's bookkeeping, which
        # takes as long as the kernel. All seeds of a stack have made the same number of steps.
        torch._fused_adam_(
            [self._values],
            [self._gradient],
            [self._first],
            [self._second],
            [],
            [self.steps if self.steps.ndim == 0 else self.steps[0]],
            amsgrad=False,
            lr=self._learning_rate,
            beta1=_BETA1,
            beta2=_BETA2,
            weight_decay=0.0,
            eps=self._epsilon,
            maximize=False,
        )
