"""Base classes of the update rules: networks, optimizers and recorded losses."""

import math
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.layers import Affine
from jbench.agents.batched.network import Layout, Network
from jbench.agents.batched.replay import Batch
from jbench.agents.batched.tensors import Tensors
from jbench.policies.layer_sequences import relu_layers
from jbench.policies.layers import Linear, SavedLayer
from jbench.policies.network import SavedNetwork
from jbench.settings.algorithms import AlgorithmSettings, Initialization, OffPolicySettings

LOSS_SUMS = "losses"
"""Name of the tensor (..., losses, 2) with the sum and the number of values of each loss."""

_TARGET = "_target"  # ends the name of a target network

_Settings = TypeVar("_Settings", bound=AlgorithmSettings)
_OffPolicySettings = TypeVar("_OffPolicySettings", bound=OffPolicySettings)


class Learner(Generic[_Settings]):
    """An update rule and its networks, for one seed or for a stack.

    Its state lies in the tensors of its `Tensors`; learners of the same view share their state. The
    first outputs of `actor` are the deterministic action before `squash`.
    """

    losses: tuple[str, ...]
    squash = "tanh"
    actor: Network

    def __init__(
        self, settings: _Settings, observation_size: int, action_size: int, view: Tensors
    ) -> None:
        """Makes the agent; `observation_size` is the number of inputs of the policy."""
        self.view = view
        self.action_size = action_size
        self.settings = settings
        self.policy_layout = Layout((observation_size, *settings.hidden_layers, action_size))
        self._loss_sums = view.state(LOSS_SUMS, len(self.losses), 2)
        self._sums_by_name = dict(zip(self.losses, self._loss_sums.unbind(dim=-2), strict=True))
        # A mean loss, and the count of 1 that is added with it.
        self._mean_and_one = view.scratch("mean_and_one", 2).fill_(1)
        self._mean = self._mean_and_one[..., 0]
        self._networks_by_name: dict[str, Network] = {}
        self._targets: list[tuple[Network, Network]] = []  # each with the network that it follows
        self._make_networks()

    def _make_networks(self) -> None:
        """Makes the networks, and what else an update needs."""

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        raise NotImplementedError

    def act(self, observations: Tensor) -> Tensor:
        """Returns deterministic actions (..., N, action_size) for inputs (..., N, inputs)."""
        actions = self.actor.forward(observations, exact=True)[..., : self.action_size]
        return actions.tanh() if self.squash == "tanh" else actions.clamp(-1, 1)

    def policy(self) -> SavedNetwork:
        """Returns a copy of one seed's deterministic policy, as it is saved in the database."""
        linear = [
            Linear(weight=_float32_copy(weight.mT), bias=_float32_copy(bias))
            for weight, bias in self.policy_layers()
        ]
        count = len(self.actor.layers)
        features = self.feature_layers(linear[:-count])
        actor = relu_layers(linear[-count:], self.squash)
        return SavedNetwork([*features, *actor])

    def load_policy(self, policy: SavedNetwork) -> None:
        """Sets the policy of one seed, bit for bit; its layers are those of `policy`."""
        for layer, saved in zip(self.policy_layers(), policy.linear_layers(), strict=True):
            layer.weight.copy_(torch.from_numpy(saved.weight).mT)
            layer.bias.copy_(torch.from_numpy(saved.bias))

    def policy_layers(self) -> list[Affine]:
        """Returns the linear layers of one seed's deterministic policy, as views."""
        *inner, (weight, bias) = self.actor.layers
        # The first outputs of a stochastic policy are the mean.
        return [*inner, Affine(weight[:, : self.action_size], bias[: self.action_size])]

    def feature_layers(self, linear: Sequence[Linear]) -> list[SavedLayer]:
        """Returns the layers of learned features, if any, of a policy from their linear layers."""
        return []

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """Resets the mean losses before updates that include the `delayed` ones, or do not."""
        self._loss_sums.zero_()

    def _record_loss(self, loss: str, values: Tensor) -> None:
        """Adds the mean of values (..., batch, 1) to the losses of a name."""
        torch.mean(values, dim=(-2, -1), out=self._mean)
        self._sums_by_name[loss].add_(self._mean_and_one)

    def _network(
        self, name: str, layout: Layout, workspace: str, make: Callable[..., Network] = Network
    ) -> Network:
        """Returns a network, saved under `name`, which is learned unless it is a target network."""
        view = self.view
        size = layout.length
        values = view.state(name, size)
        is_target = name.endswith(_TARGET)
        gradient = None if is_target else view.scratch(f"{name}.gradient", size)
        network = make(view, layout, values, gradient, workspace=workspace)
        self._networks_by_name[name] = network
        if gradient is None:
            self._targets.append((network, self._networks_by_name[name.removesuffix(_TARGET)]))
        else:
            network.step = Adam(view, name, values, gradient, self.settings.learning_rate).step
        return network


class OffPolicyLearner(Learner[_OffPolicySettings]):
    """An update rule that learns from the transitions of any policy."""

    noise_per_transition: int  # standard normal numbers that an update needs per transition
    pretraining: float = 0.0  # updates of features per control step, before the agent's first
    is_stochastic: bool = False  # whether it explores by `explore` instead of `act`
    critics: list[Network]  # of TD3 and SAC

    @property
    def critic_layout(self) -> Layout:
        """Layout of a critic, whose last inputs are the action."""
        inputs, *hidden, _ = self.policy_layout.sizes
        return Layout((inputs + self.action_size, *hidden, 1), self.action_size)

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed; targets begin as copies."""
        kind: Initialization = getattr(self.settings, "initialization", "fan-in")
        last_bound = getattr(self.settings, "last_layer_bound", None)
        for name, network in self._networks_by_name.items():
            if not name.endswith(_TARGET):
                initialize_uniform(network.layers, generator, kind, last_bound)
        self._update_targets(1)

    def _update_targets(self, tau: float) -> None:
        """Updates the target networks: target <- (1 - tau) target + tau network."""
        for target, network in self._targets:
            target.values.lerp_(network.values, tau)

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns actions (..., N, action_size) of a stochastic policy for normal noise like it."""
        raise NotImplementedError

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update changes what the rule delays, too; see `Rule`.

        TD3 delays its actor and all target networks, SAC its target networks.
        """
        return True

    def pretrain(self, batch: Batch) -> None:
        """Makes one update of its features, before those of the agent."""
        raise NotImplementedError

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Makes one update from a minibatch, whose actions and next actions it overwrites.

        Without `delayed` it leaves out what the rule delays; see `is_delayed_update`.
        """
        raise NotImplementedError

    def _critics(self, names: Sequence[str], workspaces: Sequence[str]) -> list[Network]:
        """Returns critics; each forward pass evaluates the first one before the others."""
        return [
            self._network(name, self.critic_layout, workspace)
            for name, workspace in zip(names, workspaces, strict=True)
        ]

    def _fit_critics(self, inputs: Tensor, targets: Tensor, scale: float) -> Tensor:
        """Makes a step of each towards targets y, (..., N, 1), by the gradient c (Q(s, a) - y) / N.

        Returns the sum (..., N, 1) of the squared errors before the step.
        """
        all_errors = []
        for critic in self.critics:
            errors = critic.forward(inputs) - targets
            critic.backward(errors * (scale / errors.shape[-2]))
            critic.step()
            all_errors.append(errors)
        first, second = all_errors
        return first.square().addcmul_(second, second)


def initialize_uniform(
    layers: Sequence[Affine],
    generator: Generator,
    kind: Initialization = "fan-in",
    last_bound: float | None = None,
) -> None:
    """Draws the initial parameters of one seed on the CPU from U(-b, b).

    Args:
        kind: "fan-in" for b = 1 / sqrt(inputs), as in torch.nn.Linear; "glorot" for
            b = sqrt(6 / (inputs + outputs)) and zero biases (Glorot and Bengio, 2010).
        last_bound: b of the last layer; None for the bound of `kind`.
    """
    for i, (weight, bias) in enumerate(layers):
        inputs, outputs = weight.shape[-2:]
        drawn = [weight]
        if kind == "fan-in":
            bound = 1 / math.sqrt(inputs)
            drawn.append(bias)
        else:
            bound = math.sqrt(6 / (inputs + outputs))

        if last_bound is not None and i == len(layers) - 1:
            bound = last_bound
        for parameters in drawn:
            values = torch.empty(parameters.shape, dtype=parameters.dtype)
            parameters.copy_(torch.nn.init.uniform_(values, -bound, bound, generator=generator))


def _float32_copy(values: Tensor) -> NDArray[np.float32]:
    """Returns a contiguous copy of a tensor on any device."""
    copy: NDArray[np.float32] = values.float().cpu().numpy().copy()
    return copy


def sum_over_actions(values: Tensor) -> Tensor:
    """Returns the sum (..., 1) of values (..., action_size), the values themselves if it is 1."""
    return values if values.shape[-1] == 1 else values.sum(dim=-1, keepdim=True)
