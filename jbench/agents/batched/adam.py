"""Adam over the flat parameters of one seed or of a stack (Kingma and Ba, 2015, Algorithm 1)."""

import torch
from torch import Tensor

from jbench.agents.batched.tensors import SeedView, aligned

# One launch of the GPU's kernel takes up to 36 tensors and splits them into blocks of 65,536
# numbers: the parameters of ten seeds as one tensor would occupy 15 of its 132 multiprocessors.
_PARTS, _MIN_PART = 36, 4096

_BETA1, _BETA2 = 0.9, 0.999

MOMENTS = ("first_moment", "second_moment")
"""Names of the saved tensors that have the layout of the parameters, after their prefix."""


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
        first, second = (view.saved(f"{name}.{moment}", values.shape[-1]) for moment in MOMENTS)
        self.steps = view.saved(f"{name}.steps", dtype=torch.float32)
        self._values, self._gradients = _parts(values), _parts(gradient)
        self._firsts, self._seconds = _parts(first), _parts(second)
        # All seeds of a stack have made the same number of steps.
        steps = self.steps if self.steps.ndim == 0 else self.steps[0]
        self._steps = [steps] * len(self._values)
        self._learning_rate, self._epsilon = learning_rate, epsilon

    def step(self) -> None:
        """Makes one step in place."""
        self.steps += 1
        # The kernel of torch.optim.Adam(fused=True) without the optimizer's bookkeeping, which
        # takes as long as the kernel.
        torch._fused_adam_(
            self._values,
            self._gradients,
            self._firsts,
            self._seconds,
            [],
            self._steps,
            amsgrad=False,
            lr=self._learning_rate,
            beta1=_BETA1,
            beta2=_BETA2,
            weight_decay=0.0,
            eps=self._epsilon,
            maximize=False,
        )


def _parts(flat: Tensor) -> list[Tensor]:
    """Returns one seed's tensor, or a stack's in parts that together occupy a GPU."""
    if flat.ndim == 1:
        return [flat]
    size = max(_MIN_PART, aligned(-(-flat.numel() // _PARTS)))
    return list(flat.view(-1).split(size))
