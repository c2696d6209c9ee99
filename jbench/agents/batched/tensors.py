"""Tensors of several seeds' agents, stacked along a leading axis."""

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
    start, parts = 0, []
    for shape in shapes:
        count = math.prod(shape)
        parts.append(flat[..., start : start + count].view((*flat.shape[:-1], *shape)))
        start += aligned(count)
    return parts


class Tensors:
    """Named tensors of several agents.

    Attributes:
        saved: (seeds, ...) tensors by name, the complete state of the agents.
        low_precision: whether networks multiply their hidden layers in bfloat16.
    """

    def __init__(
        self,
        seeds: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
        *,
        low_precision: bool = False,
    ) -> None:
        """Starts without tensors."""
        self.seeds, self.dtype, self.low_precision = seeds, dtype, low_precision
        self.device = torch.device(device)
        self.saved: dict[str, Tensor] = {}
        self._scratch: dict[tuple[object, ...], Tensor] = {}

    def transfer_buffers(self, shape: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Returns a buffer on the CPU and one on the device: on a CPU, the same buffer twice.

        With a GPU, the former is pinned memory, from which it copies without waiting.
        """
        buffer = torch.empty(tuple(shape), dtype=self.dtype, device=self.device)
        if self.device.type != "cuda":
            return buffer, buffer
        return torch.empty(tuple(shape), dtype=self.dtype, pin_memory=True), buffer

    def saved_tensor(self, name: str, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        """Returns the (seeds, *shape) tensor of a name; zeros if it is new."""
        if name not in self.saved:
            self.saved[name] = self._zeros((self.seeds, *shape), dtype)
        return self.saved[name]

    def scratch_tensor(
        self, name: str, shape: tuple[int, ...], dtype: torch.dtype | None
    ) -> Tensor:
        """Returns a buffer, the same one at every call; its content is arbitrary."""
        key = (name, shape, dtype)
        if key not in self._scratch:
            self._scratch[key] = self._zeros(shape, dtype)
        return self._scratch[key]

    def _zeros(self, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        return torch.zeros(shape, dtype=dtype or self.dtype, device=self.device)


class SeedView:
    """The tensors of one seed, or of the whole stack.

    Update rules are written once for both cases. On a CPU one matrix product per seed is faster
    than a batched product, and one seed's activations stay in the cache; a GPU is faster on the
    whole stack.

    Attributes:
        batch_shape: leading axes of all tensors: () for one seed, (seeds,) for the stack.
    """

    def __init__(self, tensors: Tensors, seed: int | None = None) -> None:
        """Selects the seed with this index, without the axis of seeds, or all for None."""
        self._tensors, self._seed = tensors, seed
        self.batch_shape: tuple[int, ...] = (tensors.seeds,) if seed is None else ()

    @property
    def is_stack(self) -> bool:
        """Whether these are the tensors of all seeds, with a leading axis."""
        return self._seed is None

    @property
    def device(self) -> torch.device:
        """Device of the tensors."""
        return self._tensors.device

    @property
    def low_precision(self) -> bool:
        """Whether networks multiply their hidden layers in bfloat16."""
        return self._tensors.low_precision

    def saved(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a tensor (*batch_shape, *shape) of the agent's state; zeros at first."""
        stacked = self._tensors.saved_tensor(name, shape, dtype)
        return stacked if self._seed is None else stacked[self._seed]

    def scratch(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a buffer (*batch_shape, *shape) for use within an update.

        Views of single seeds share it, because they are updated one after another.
        """
        return self._tensors.scratch_tensor(name, (*self.batch_shape, *shape), dtype)
