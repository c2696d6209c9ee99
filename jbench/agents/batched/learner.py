"""What the update rules share: how their networks are made, and how their losses are recorded."""

import math
from collections.abc import Callable, Sequence
from typing import ClassVar

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.network import Affine, Network, Sizes, parameter_count
from jbench.agents.batched.tensors import Part
from jbench.policies.feature_map import FeatureMap
from jbench.settings.algorithms import AlgorithmSettings, Initialization

LOSS_SUMS = "losses"
"""Name of the tensor (..., losses, 2) with the sum and the number of values of each loss."""


class Learner:
    """An update rule and its networks, for one seed or for a stack.

    All that it must remember is kept by its `Part`; two learners of the same part are one.
    """

    losses: ClassVar[tuple[str, ...]]
    """The losses that an update records, by their names in the database."""

    def __init__(
        self,
        settings: AlgorithmSettings,
        observation_size: int,
        part: Part,
        low_precision: bool = False,
    ) -> None:
        """Looks at the numbers of a part.

        Args:
            settings: of the algorithm.
            observation_size: what the networks see.
            part: whose numbers.
            low_precision: whether hidden layers are multiplied in bfloat16.
        """
        self.part, self._low_precision = part, low_precision
        self._learning_rate = settings.learning_rate
        self.policy_sizes = (observation_size, *settings.hidden_layers, 1)
        self.value_sizes = (observation_size + 1, *settings.hidden_layers, 1)
        self._noted = part.keep(LOSS_SUMS, len(self.losses), 2)
        self._notes = dict(zip(self.losses, self._noted.unbind(dim=-2), strict=True))
        note = part.scratch("note", 2).fill_(1)
        self._note, self._noted_mean = note, note[..., 0]

    def initialize(self, generator: Generator) -> None:
        """Draws the first parameters of one seed."""
        raise NotImplementedError

    def act(self, observations: Tensor) -> Tensor:
        """Returns the policy's actions (..., N, 1), without noise, for (..., N, inputs)."""
        raise NotImplementedError

    def policy(self) -> tuple[Network, str]:
        """Returns the network of the deterministic policy and what bounds its first output.

        The second is "tanh" or "clip".
        """
        raise NotImplementedError

    def feature_map(self) -> FeatureMap | None:
        """Returns a copy of the features that the policy sees, or None if it sees observations."""
        return None

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """Resets the mean losses.

        Args:
            delayed: of the updates that follow, whether each includes the delayed ones.
        """
        self._noted.zero_()

    def _record_loss(self, loss: str, values: Tensor) -> None:
        """Adds the mean of (..., batch, 1) values to a loss."""
        torch.mean(values, dim=(-2, -1), out=self._noted_mean)
        self._notes[loss].add_(self._note)

    def _network(
        self,
        name: str,
        sizes: Sizes,
        workspace: str,
        learned: bool = True,
        joins: int = 0,
        make: Callable[..., Network] = Network,
    ) -> Network:
        """Returns a network whose parameters are kept under a name; see `Network`."""
        count = parameter_count(sizes, joins)
        return make(
            self.part,
            sizes,
            self.part.keep(name, count),
            self.part.scratch(f"{name}.gradient", count) if learned else None,
            workspace=workspace,
            low_precision=self._low_precision,
            joins=joins,
        )

    def _adam(self, name: str, network: Network) -> Adam:
        """Returns the optimiser of a network, its moments kept under a name."""
        assert network.gradient is not None
        return Adam(self.part, name, network.values, network.gradient, self._learning_rate)


class OffPolicyLearner(Learner):
    """An update rule that learns from transitions, whichever policy made them."""

    noise_per_transition: ClassVar[int]
    """Normal numbers that an update needs for each transition."""

    random_policy: ClassVar[bool] = False
    """Whether `explore` needs noise."""

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns actions (..., N, 1) to learn from, before any action noise is added.

        Args:
            observations: (..., N, inputs).
            noise: (..., N, 1) standard normal numbers, for a policy that is random itself.
        """
        return self.act(observations)

    def pretraining(self, control_steps: int) -> int:
        """Returns the number of calls of `pretrain` before the first update.

        Args:
            control_steps: of the seed before the first update.
        """
        return 0

    def pretrain(self, batch: Batch) -> None:
        """Learns features from a minibatch before the agent learns anything."""
        raise NotImplementedError

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update includes what TD3 and SAC update less often.

        Args:
            update: its number since the first, counted from 1.
            update_of_call: its number among those that are due at a time, counted from 0.
        """
        return True

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Learns from a minibatch of N transitions (s, a, r, s').

        Args:
            batch: of which actions and next actions are overwritten.
            delayed: whether the delayed updates are due, too; see `is_delayed_update`.
        """
        raise NotImplementedError

    def _critics(
        self, names: Sequence[str], workspaces: Sequence[str], learned: bool = True, joins: int = 0
    ) -> list[Network]:
        """Returns critics that are asked about the same pairs, the first one before the others."""
        sizes = self.value_sizes
        pairs = zip(names, workspaces, strict=True)
        return [self._network(name, sizes, workspace, learned, joins) for name, workspace in pairs]


def initialize_uniform(
    layers: Sequence[Affine],
    generator: Generator,
    kind: Initialization = "fan-in",
    last_bound: float | None = None,
) -> None:
    """Draws the first parameters of the layers of one seed on the CPU.

    Args:
        layers: of one seed.
        generator: of its random numbers.
        kind: "fan-in" for U(-b, b) with b = 1 / sqrt(inputs), as torch's linear layers have it;
            "glorot" for b = sqrt(6 / (inputs + outputs)) and zero biases (Glorot and Bengio, 2010).
        last_bound: b of the last layer; None for that of its kind.
    """
    for i, (weight, bias) in enumerate(layers):
        inputs, outputs = weight.shape[-2:]
        bound = 1 / math.sqrt(inputs) if kind == "fan-in" else math.sqrt(6 / (inputs + outputs))
        if last_bound is not None and i == len(layers) - 1:
            bound = last_bound
        for parameters in (weight, bias) if kind == "fan-in" else (weight,):
            drawn = torch.empty(parameters.shape, dtype=parameters.dtype)
            parameters.copy_(torch.nn.init.uniform_(drawn, -bound, bound, generator=generator))


def polyak_update(target: Network, network: Network, tau: float) -> None:
    """Moves the parameters of a target network a step of `tau` towards those of another."""
    target.values.lerp_(network.values, tau)


def tanh_gradient(gradient: Tensor, outputs: Tensor) -> Tensor:
    """Returns the gradient by the inputs of tanh, given that by its outputs, and these."""
    by_inputs: Tensor = torch.ops.aten.tanh_backward(gradient, outputs)
    return by_inputs
