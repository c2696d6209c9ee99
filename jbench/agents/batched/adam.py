"""Adam over the flat parameters of one seed or of a stack (Kingma and Ba, 2015, Algorithm 1)."""

from functools import partial

import torch
from torch import Tensor

from jbench.agents.batched.tensors import Tensors


class Adam:
    """Adam for one flat vector of parameters.

    Attributes:
        steps: (...,) number of steps made, float32.
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
        """Refers to parameters and their gradient, both (..., count), without copying them.

        Args:
            name: prefix of the saved tensors.
            epsilon: added to the root of the second moment.
        """
        count = values.shape[-1]
        first, second = (view.state(f"{name}.{n}_moment", count) for n in ("first", "second"))
        self.steps = view.state(f"{name}.steps", dtype=torch.float32)
        # All seeds of a stack have made the same number of steps.
        steps = self.steps if self.steps.ndim == 0 else self.steps[0]
        # The kernel of torch.optim.Adam(fused=True) without the optimizer's bookkeeping, which
        # takes as long as the kernel.
        self._update = partial(
            torch._fused_adam_,
            *([values], [gradient], [first], [second], [], [steps]),
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
