"""Where the agents of several seeds keep their numbers: stacked, with a leading axis of seeds."""

import torch
from torch import Tensor

# 64 bytes of float32: a vector of the processor, a line of its cache.
_ALIGNMENT = 16


def aligned(count: int) -> int:
    """Returns the next multiple of 16: where the next of several parts of a tensor may begin.

    Kernels may round differently by where their memory begins, and no seed may notice its
    neighbours in a stack.
    """
    return -(-count // _ALIGNMENT) * _ALIGNMENT


class Tensors:
    """The tensors of a number of agents by name, each (seeds, ...): all that they remember."""

    def __init__(
        self,
        seeds: int,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ) -> None:
        """Begins with none."""
        self.seeds = seeds
        self.dtype = dtype
        self.device = torch.device(device)
        self.kept: dict[str, Tensor] = {}
        self._scratch: dict[tuple[object, ...], Tensor] = {}

    def of(self, seed: int) -> "Part":
        """Returns the part of the seed with the given place in the stack, without seeds' axis."""
        return Part(self, seed)

    def all(self) -> "Part":
        """Returns the whole stack: tensors with a leading axis of seeds."""
        return Part(self, None)

    def keep(self, name: str, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        """Returns the (seeds, *shape) tensor of a name, zeros where it is new."""
        if name not in self.kept:
            self.kept[name] = self._zeros((self.seeds, *shape), dtype)
        return self.kept[name]

    def lend(self, name: str, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        """Returns a tensor that is written before it is read, the same one at every call."""
        key = (name, shape, dtype)
        if key not in self._scratch:
            self._scratch[key] = self._zeros(shape, dtype)
        return self._scratch[key]

    def _zeros(self, shape: tuple[int, ...], dtype: torch.dtype | None) -> Tensor:
        return torch.zeros(shape, dtype=dtype or self.dtype, device=self.device)


class Part:
    """What one agent of a stack sees of its tensors, or all agents at a time.

    An update rule is written once for both: its tensors have no leading axes, or that of seeds.
    On the CPU a product of matrices for each seed is faster than a batch of products, and the
    activations of one seed stay in the processor's cache while it learns; a GPU wants them all.

    Attributes:
        lead: the leading axes of all its tensors: (), or (seeds,).
    """

    def __init__(self, tensors: Tensors, seed: int | None) -> None:
        """Looks at one seed, or at all for None."""
        self._tensors, self._seed = tensors, seed
        self.lead = (tensors.seeds,) if seed is None else ()

    @property
    def device(self) -> torch.device:
        """Where the numbers are."""
        return self._tensors.device

    def keep(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a tensor (*lead, *shape) that is saved and restored; zeros at first."""
        stacked = self._tensors.keep(name, shape, dtype)
        return stacked if self._seed is None else stacked[self._seed]

    def scratch(self, name: str, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        """Returns a tensor (*lead, *shape) that nobody relies on after an update.

        All seeds that are looked at alone share it: they learn one after another.
        """
        return self._tensors.lend(name, (*self.lead, *shape), dtype)
