"""The agents of several seeds."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Concatenate, Generic, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.agents.batched.generators import Generators
from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.padding import with_padding, without_padding
from jbench.agents.batched.tensors import SeedView, Tensors
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import AlgorithmSettings

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

    The tensors of a seed with fewer inputs than others are padded: the weights of missing inputs
    are 0 and stay 0, because those inputs are 0. States and policies are not padded.

    Attributes:
        generators: one per seed.
        tensors: the state of the agents.
        each: a learner per seed.
        groups: one per seed, or one of all seeds.
    """

    def __init__(
        self,
        learner: Callable[..., _Learner],
        settings: AlgorithmSettings,
        sizes: Sequence[int],
        action_size: int,
        generators: Sequence[Generators],
        tensors: Tensors,
        *,
        stacked: bool,
    ) -> None:
        """Makes the learners; all parameters are zeros.

        Args:
            sizes: number of inputs of the policy of each seed.
            generators: one per seed.
            stacked: whether to compute all seeds in one stack or one after another.
        """
        self.generators, self.tensors = generators, tensors
        self._sizes, largest = sizes, max(sizes)
        self._make = partial(learner, settings, action_size=action_size)
        # It comes first, because it decides how the tensors lie in memory.
        self._stack = self._make(largest, view=SeedView(tensors)) if stacked else None
        self.each = [
            self._make(largest, view=SeedView(tensors, seed)) for seed in range(len(sizes))
        ]
        self._padding = [
            learner.input_weights(slice(size, largest)) if size < largest else {}
            for size, learner in zip(sizes, self.each, strict=True)
        ]
        self.groups = (
            [
                Group(learner, range(seed, seed + 1), [generators[seed]])
                for seed, learner in enumerate(self.each)
            ]
            if self._stack is None
            else [Group(self._stack, range(tensors.seeds), generators)]
        )
        self._captured = Captured(tensors.device)
        self._inputs: dict[Hashable, list[tuple[Tensor, Tensor]]] = {}
        self._outputs: dict[Hashable, Tensor] = {}

    def initialize(self) -> None:
        """Draws the initial parameters of every seed."""
        for seed, own in enumerate(self.generators):
            with self._unpadded(seed) as learner:
                learner.initialize(own.weights())

    def policy(self, seed: int) -> SavedNetwork:
        """Returns a copy of the deterministic policy of a seed."""
        with self._unpadded(seed) as learner:
            return learner.policy()

    def load_policy(self, seed: int, policy: SavedNetwork) -> None:
        """Sets the deterministic policy of a seed; see `Learner.load_policy`."""
        with self._unpadded(seed) as learner:
            learner.load_policy(policy)

    def state(self, seed: int) -> dict[str, Tensor]:
        """Returns the state of the agent of a seed by name."""
        padding = self._padding[seed]
        return {
            name: without_padding(saved[seed], padding.get(name, []))
            for name, saved in self.tensors.saved.items()
        }

    def restore(self, seed: int, state: Mapping[str, Tensor]) -> None:
        """Restores what `state` returned."""
        padding = self._padding[seed]
        for name, saved in self.tensors.saved.items():
            saved[seed] = with_padding(state[name], padding.get(name, []))

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
            of_seeds = zip(self.each, *(x.to(self.tensors.dtype) for x in inputs), strict=True)
            return torch.stack([method(agent, *own) for agent, *own in of_seeds])
        key = (method, *(x.shape for x in inputs))
        if key not in self._inputs:
            self._inputs[key] = [self.tensors.transfer_buffers(x.shape) for x in inputs]
        for (on_cpu, on_device), x in zip(self._inputs[key], inputs, strict=True):
            on_cpu.copy_(x)
            # The copy of the outputs below waits until this one is complete.
            on_device.copy_(on_cpu, non_blocking=True)
        self._captured(self._run_stack, key)
        return self._outputs[key].cpu()

    @contextmanager
    def _unpadded(self, seed: int) -> Iterator[_Learner]:
        """Yields the learner of a seed in its own sizes; changes of its state are kept."""
        if not self._padding[seed]:
            yield self.each[seed]
            return
        own = Tensors(1, self.tensors.dtype)
        learner = self._make(self._sizes[seed], view=SeedView(own, 0))
        for name, values in self.state(seed).items():
            own.saved[name][0] = values
        yield learner
        self.restore(seed, {name: saved[0] for name, saved in own.saved.items()})

    def _run_stack(self, key: Hashable) -> None:
        assert isinstance(key, tuple)
        self._outputs[key] = key[0](self._stack, *(x for _, x in self._inputs[key]))
