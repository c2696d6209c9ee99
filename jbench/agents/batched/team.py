"""The agents of several seeds as one."""

from collections.abc import Callable, Hashable, Sequence
from typing import Concatenate, Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from jbench.agents.batched.graphs import Captured
from jbench.agents.batched.learner import Learner
from jbench.agents.batched.network import affines
from jbench.agents.batched.streams import Streams
from jbench.agents.batched.tensors import Tensors
from jbench.policies.saved import Policy
from jbench.settings.algorithms import AlgorithmSettings

Rule = TypeVar("Rule", bound=Learner)
Method = Callable[Concatenate[Rule, ...], Tensor]


class Group(NamedTuple, Generic[Rule]):
    """Agents that learn in one sequence of products.

    Attributes:
        learner: of them.
        seeds: their places among all seeds.
    """

    learner: Rule
    seeds: range

    def of(self, streams: Sequence[Streams]) -> Sequence[Streams]:
        """Returns the streams of its seeds, of those of all."""
        return streams[self.seeds.start : self.seeds.stop]


class Team(Generic[Rule]):
    """A learner for each seed, and perhaps one for all, over the same tensors.

    Attributes:
        tensors: all that the agents remember.
        each: a learner for each seed.
        groups: of agents that learn at the same time: each seed by itself, or all.
    """

    def __init__(
        self,
        rule: Callable[..., Rule],
        settings: AlgorithmSettings,
        observation_size: int,
        tensors: Tensors,
        *,
        stacked: bool,
        low_precision: bool = False,
    ) -> None:
        """Makes the learners; their numbers are zeros.

        Args:
            rule: what they learn by.
            settings: of the rule.
            observation_size: numbers in an observation.
            tensors: where their numbers are.
            stacked: whether all seeds are computed in one stack, or one after another.
            low_precision: whether hidden layers are multiplied in bfloat16.
        """
        self.tensors = tensors
        parts = [tensors.of(seed) for seed in range(tensors.seeds)]
        self.each = [rule(settings, observation_size, part, low_precision) for part in parts]
        self._stack: Rule | None = None
        if stacked:
            self._stack = rule(settings, observation_size, tensors.all(), low_precision)
        self.groups = (
            [Group(learner, range(seed, seed + 1)) for seed, learner in enumerate(self.each)]
            if self._stack is None
            else [Group(self._stack, range(tensors.seeds))]
        )
        self._captured = Captured(self._run_stack, tensors.device)
        self._inputs: dict[Hashable, list[Tensor]] = {}
        self._outputs: dict[Hashable, Tensor] = {}

    def initialize(self, streams: Sequence[Streams]) -> None:
        """Draws the first parameters of every seed."""
        for learner, stream in zip(self.each, streams, strict=True):
            learner.initialize(stream.weights())

    def run(self, method: Method[Rule], *inputs: Tensor) -> Tensor:
        """Evaluates a method of every agent on its part of the inputs.

        Args:
            method: function of a learner and tensors (..., N, any); the same object at every call,
                since a GPU keeps a recording of each.
            inputs: (seeds, N, any).

        Returns:
            (seeds, N, any), on the CPU.
        """
        if self._stack is None:
            of_seeds = zip(self.each, *(x.to(self.tensors.dtype) for x in inputs), strict=True)
            return torch.stack([method(agent, *own) for agent, *own in of_seeds])
        key = (method, *(part.shape for part in inputs))
        if key not in self._inputs:
            self._inputs[key] = [
                torch.empty(part.shape, dtype=self.tensors.dtype, device=self.tensors.device)
                for part in inputs
            ]
        for memory, part in zip(self._inputs[key], inputs, strict=True):
            memory.copy_(part)
        self._captured(key)
        return self._outputs[key].cpu()

    def policy(self, seed: int) -> Policy:
        """Returns a copy of one seed's deterministic policy as it is kept in the database."""
        network, squash = self.each[seed].policy()
        layers = affines(network.values.float().cpu(), network.sizes)
        weights = [layer.weight.mT.numpy().copy() for layer in layers]
        biases = [layer.bias.numpy().copy() for layer in layers]
        # Of a random policy, the first output is the mean.
        return Policy(
            [*weights[:-1], weights[-1][:1]],
            [*biases[:-1], biases[-1][:1]],
            squash,
            self.each[seed].feature_map(),
        )

    def _run_stack(self, key: Hashable) -> None:
        assert isinstance(key, tuple)
        self._outputs[key] = key[0](self._stack, *self._inputs[key])
