"""Tensors of several seeds' agents, stacked along a leading axis."""

import copy
import math
from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

# 64 bytes of float32: a processor vector and a cache line.
_ALIGNMENT = 16


def aligned(count: int) -> int:
    """Returns the next multiple of 16, at which the next part of a flat tensor may begin.

    Kernels may round differently depending on the alignment of their memory, and a seed's numbers
    must not depend on its position in a stack.
    """
    return -(-count // _ALIGNMENT) * _ALIGNMENT


def flat_size(shapes: Iterable[Sequence[int]]) -> int:
    """Returns the length of a flat tensor with parts of these shapes, alignment included."""
    return sum(aligned(math.prod(shape)) for shape in shapes)


def flat_parts(flat: Tensor, shapes: Iterable[Sequence[int]]) -> list[Tensor]:
    """Returns views (..., *shape) of the parts of a flat tensor (..., flat_size(shapes))."""
    start = 0
    parts = []
    for shape in shapes:
        count = math.prod(shape)
        parts.append(flat[..., start : start + count].view((*flat.shape[:-1], *shape)))
        start += aligned(count)
    return parts


class Tensors:
    """Named tensors of several agents, and the part of them that belongs to one seed.

    Update rules are written once, for one seed or for the stack of all. On a CPU one matrix product
    per seed is faster than a batched product, and one seed's activations stay in the cache; a GPU
    is faster on the whole stack.

    Attributes:
        saved: (seeds, ...) tensors of all seeds by name, the complete state of the agents.
        batch_shape: leading axes of `state` and `scratch`: () for one seed, (seeds,) for the stack.
    """

    def __init__(
        self,
        seeds: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
        *,
        low_precision: bool = False,
    ) -> None:
        self.seeds = seeds
        self.dtype = dtype
        self.low_precision = low_precision
        self.device = torch.device(device)
        self.batch_shape: tuple[int, ...] = (seeds,)
        self.saved: dict[str, Tensor] = {}
        self._seed: int | None = None
        self._scratch: dict[tuple[object, ...], Tensor] = {}

    def select(self, seed: int) -> "Tensors":
        """Returns the same tensors as seen by the seed with this index, without its axis."""
        view = copy.copy(self)
        view._seed = seed
        view.batch_shape = ()
        return view

    @property
    def is_stack(self) -> bool:
        """Whether these are the tensors of all seeds, with a leading axis."""
        return self._seed is None

    def state(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a tensor (*batch_shape, *shape) of the agent's state; zeros at first."""
        if name not in self.saved:
            self.saved[name] = self._zeros((self.seeds, *shape), dtype)
        return self.saved[name] if self._seed is None else self.saved[name][self._seed]

    def scratch(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a buffer (*batch_shape, *shape) for use within an update, its content arbitrary.

        It is the same at every call. Single seeds share it: they are updated one after another.
        """
        key = (name, *self.batch_shape, *shape, dtype)
        if key not in self._scratch:
            self._scratch[key] = self._zeros((*self.batch_shape, *shape), dtype)
        return self._scratch[key]

    def _zeros(self, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        """Returns a new tensor on the device, by default of the agents' type."""
        return torch.zeros(shape, dtype=dtype or self.dtype, device=self.device)
