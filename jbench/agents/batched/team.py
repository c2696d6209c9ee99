"""The agents of several seeds."""

from collections.abc import Callable, Hashable, Sequence
from typing import Concatenate, Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.tensors import Tensors
from jbench.settings.algorithms import AlgorithmSettings

_Learner = TypeVar("_Learner", bound=Learner)
Method = Callable[Concatenate[_Learner, ...], Tensor]


class Group(NamedTuple, Generic[_Learner]):
    """Seeds that are updated together.

    Attributes:
        learner: of these seeds.
        seeds: their indices.
    """

    learner: _Learner
    seeds: range

    def select(self, streams: Sequence[Streams]) -> Sequence[Streams]:
        """Returns the streams of the group's seeds."""
        return streams[self.seeds.start : self.seeds.stop]


class Team(Generic[_Learner]):
    """One learner per seed, and optionally one for the whole stack, on the same tensors.

    Attributes:
        tensors: the state of the agents.
        each: a learner per seed.
        groups: one per seed, or one of all seeds.
    """

    def __init__(
        self,
        learner: Callable[..., _Learner],
        settings: AlgorithmSettings,
        observation_size: int,
        tensors: Tensors,
        *,
        stacked: bool,
        low_precision: bool = False,
    ) -> None:
        """Makes the learners; all parameters are zeros.

        Args:
            learner: class of the learners.
            observation_size: number of inputs of the policy.
            stacked: whether to compute all seeds in one stack or one after another.
            low_precision: whether to multiply hidden layers in bfloat16.
        """
        self.tensors = tensors
        self._stack: _Learner | None = None
        if stacked:
            # It comes first, because it decides how the tensors lie in memory.
            self._stack = learner(settings, observation_size, tensors.stacked_view(), low_precision)
        views = [tensors.seed_view(seed) for seed in range(tensors.seeds)]
        self.each = [learner(settings, observation_size, view, low_precision) for view in views]
        self.groups = (
            [Group(learner, range(seed, seed + 1)) for seed, learner in enumerate(self.each)]
            if self._stack is None
            else [Group(self._stack, range(tensors.seeds))]
        )
        self._captured = Captured(self._run_stack, tensors.device)
        self._inputs: dict[Hashable, list[tuple[Tensor, Tensor]]] = {}
        self._outputs: dict[Hashable, Tensor] = {}

    def initialize(self, streams: Sequence[Streams]) -> None:
        """Draws the initial parameters of every seed."""
        for learner, stream in zip(self.each, streams, strict=True):
            learner.initialize(stream.weights())

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
        self._captured(key)
        return self._outputs[key].cpu()

    def _run_stack(self, key: Hashable) -> None:
        assert isinstance(key, tuple)
        self._outputs[key] = key[0](self._stack, *(x for _, x in self._inputs[key]))
