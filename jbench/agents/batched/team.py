"""The agents of several seeds."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any, Concatenate, Generic, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.tensors import SeedView, Tensors
from jbench.agents.generators import Generators

_Learner = TypeVar("_Learner", bound=Learner)
Method = Callable[Concatenate[_Learner, ...], Tensor]


class Group(NamedTuple, Generic[_Learner]):
    """Seeds that are updated together."""

    learner: _Learner
    seeds: range
    generators: Sequence[Generators]

    def stack(self, per_seed: Sequence[NDArray[Any]], offset: int = 0) -> Tensor:
        """Stacks the draws of each seed for the device, to which a GPU copies without waiting.

        Args:
            per_seed: (count, ...) of each seed.
            offset: added once to those of the second seed, twice to those of the third, and so on.

        Returns:
            (count, seeds, ...); (count, ...) on the CPU for one seed without a stack.
        """
        if not self.learner.view.is_stack:
            return torch.from_numpy(per_seed[0])
        if offset:
            per_seed = [draws + seed * offset for seed, draws in enumerate(per_seed)]
        device, (count, *shape) = self.learner.view.device, per_seed[0].shape
        on_cpu = torch.empty(
            (count, len(per_seed), *shape),
            dtype=torch.from_numpy(per_seed[0]).dtype,
            pin_memory=device.type == "cuda",
        )
        np.stack(per_seed, axis=1, out=on_cpu.numpy())
        return on_cpu.to(device, non_blocking=True)


class Team(Generic[_Learner]):
    """One learner per seed, and optionally one for the whole stack, on the same tensors.

    Attributes:
        generators: one per seed.
        tensors: the state of the agents.
        learners: one per seed.
        groups: one per seed, or one of all seeds.
    """

    def __init__(
        self,
        make: Callable[..., _Learner],
        generators: Sequence[Generators],
        tensors: Tensors,
        *,
        stacked: bool,
    ) -> None:
        """Makes the learners; all parameters are zeros.

        Args:
            make: makes the learner of a `view`.
            generators: one per seed.
            stacked: whether to compute all seeds in one stack or one after another.
        """
        self.generators, self.tensors = generators, tensors
        seeds = range(len(generators))
        self.learners = [make(view=SeedView(tensors, seed)) for seed in seeds]
        self._stack = make(view=SeedView(tensors)) if stacked else None
        self.groups = (
            [
                Group(learner, seeds[seed : seed + 1], [generators[seed]])
                for seed, learner in enumerate(self.learners)
            ]
            if self._stack is None
            else [Group(self._stack, seeds, generators)]
        )
        self._captured = Captured(tensors.device)
        self._inputs: dict[Hashable, list[tuple[Tensor, Tensor]]] = {}
        self._outputs: dict[Hashable, Tensor] = {}

    def run(self, method: Method[_Learner], *inputs: Tensor) -> Tensor:
        """Evaluates a method of every agent on its inputs.

        Args:
            method: function of a learner and tensors (..., N, any); it must be the same object at
                every call, because it is recorded on a GPU.
            inputs: (seeds, N, any).

        Returns:
            (seeds, N, any), on the CPU.
        """
        if self._stack is None:
            per_seed = zip(self.learners, *(x.to(self.tensors.dtype) for x in inputs), strict=True)
            return torch.stack([method(agent, *arguments) for agent, *arguments in per_seed])
        key = (method, *(x.shape for x in inputs))
        if key not in self._inputs:
            self._inputs[key] = [self.tensors.transfer_buffers(x.shape) for x in inputs]
        for (on_cpu, on_device), x in zip(self._inputs[key], inputs, strict=True):
            on_cpu.copy_(x)
            # The copy of the outputs below waits until this one is complete.
            on_device.copy_(on_cpu, non_blocking=True)
        self._captured(self._run_stack, key)
        return self._outputs[key].cpu()

    def _run_stack(self, key: Hashable) -> None:
        assert isinstance(key, tuple)
        self._outputs[key] = key[0](self._stack, *(x for _, x in self._inputs[key]))
