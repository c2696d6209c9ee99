"""Base classes of the update rules: networks, optimizers and recorded losses."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Generator, Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.batch import Batch
from jbench.agents.batched.layers import Affine
from jbench.agents.batched.network import Layout, Network, Twins
from jbench.agents.batched.tensors import Tensors
from jbench.policies.network import SavedLayer, SavedNetwork, linear_layer, relu_layers
from jbench.settings.algorithms import AlgorithmSettings, Initialization

LOSS_SUMS = "losses"
"""Name of the tensor (..., losses, 2) with the sum and the number of values of each loss."""

OTHER_LAYERS = "its layers are not those of its settings"
"""Why a policy can't be loaded."""


class Learner:
    """An update rule and its networks, for one seed or for a stack.

    Its state lies in the tensors of its `Tensors`; learners of the same view share their state.

    Attributes:
        action_size: numbers in an action, each in [-1, 1].
        policy_layout: of the network of the policy.
    """

    losses: tuple[str, ...]
    """Names of the recorded losses, as in the database."""

    def __init__(
        self, settings: AlgorithmSettings, observation_size: int, action_size: int, view: Tensors
    ) -> None:
        """Makes the networks.

        Args:
            observation_size: number of inputs of the policy.
        """
        self.view, self.action_size = view, action_size
        self._learning_rate = settings.learning_rate
        self.policy_layout = Layout((observation_size, *settings.hidden_layers, action_size))
        self._loss_sums = view.state(LOSS_SUMS, len(self.losses), 2)
        self._sums_by_name = dict(zip(self.losses, self._loss_sums.unbind(dim=-2), strict=True))
        # A mean loss, and the count of 1 that is added with it.
        self._mean_and_one = view.scratch("mean_and_one", 2).fill_(1)
        self._mean = self._mean_and_one[..., 0]

    def initialize(self, generator: Generator) -> None:
        """Draws the initial parameters of one seed."""
        raise NotImplementedError

    def act(self, observations: Tensor) -> Tensor:
        """Returns deterministic actions (..., N, action_size) for inputs (..., N, inputs)."""
        raise NotImplementedError

    def policy_network(self) -> tuple[Network, str]:
        """Returns the network of the deterministic policy, and what bounds it: "tanh" or "clip"."""
        raise NotImplementedError

    def policy(self) -> SavedNetwork:
        """Returns a copy of one seed's deterministic policy, as it is saved in the database."""
        network, squash = self.policy_network()
        *inner, last = [
            (layer.weight.mT.numpy().copy(), layer.bias.numpy().copy())
            for layer in network.layout.views(network.values.float().cpu())
        ]
        # The first outputs of a stochastic policy are the mean.
        mean = [parameters[: self.action_size] for parameters in last]
        linear = [linear_layer(*parameters) for parameters in (*inner, mean)]
        return SavedNetwork([*self.feature_layers(), *relu_layers(linear, squash)])

    def load_policy(self, policy: SavedNetwork) -> None:
        """Sets the deterministic policy of one seed; inverts `policy`, bit for bit.

        Raises:
            ValueError: if the policy has other layers than the learner.
        """
        if policy.structure() != self.policy().structure():
            raise ValueError(OTHER_LAYERS)
        network, _ = self.policy_network()
        layers = network.layers
        for layer, saved in zip(layers, policy.linear_layers()[-len(layers) :], strict=True):
            weight, bias = saved.arrays["weight"], saved.arrays["bias"]
            layer.weight[:, : len(weight)] = torch.from_numpy(weight).mT
            layer.bias[: len(bias)] = torch.from_numpy(bias)
        self.load_feature_layers(policy.layers)

    def feature_layers(self) -> list[SavedLayer]:
        """Returns the layers of learned features, which the policy takes; none for observations."""
        return []

    def load_feature_layers(self, layers: Sequence[SavedLayer]) -> None:
        """Sets learned features; inverts `feature_layers`, bit for bit.

        Args:
            layers: of a policy, which begin with those of the features.
        """

    def reset_losses(self, delayed: Sequence[bool]) -> None:
        """Resets the mean losses.

        Args:
            delayed: for each of the following updates, whether it includes the delayed ones.
        """
        self._loss_sums.zero_()

    def _record_loss(self, loss: str, values: Tensor) -> None:
        """Records the mean of (..., batch, 1) values."""
        torch.mean(values, dim=(-2, -1), out=self._mean)
        self._sums_by_name[loss].add_(self._mean_and_one)

    def _network(
        self,
        name: str,
        layout: Layout,
        workspace: str,
        learned: bool = True,
        make: Callable[..., Network] = Network,
    ) -> Network:
        """Returns a network whose parameters are saved under `name`; see `Network`."""
        values = self.view.state(name, layout.length)
        gradient = self.view.scratch(f"{name}.gradient", layout.length) if learned else None
        return make(self.view, layout, values, gradient, workspace=workspace)

    def _adam(self, name: str, network: Network) -> Adam:
        """Returns the optimizer of a network; its moments are saved under `name`."""
        assert network.gradient is not None
        return Adam(self.view, name, network.values, network.gradient, self._learning_rate)


class OffPolicyLearner(Learner):
    """An update rule that learns from the transitions of any policy."""

    noise_per_transition: int
    """Standard normal numbers that an update needs per transition."""

    is_stochastic: bool = False
    """Whether the policy is stochastic, so that it explores by `explore` instead of `act`."""

    @property
    def critic_layout(self) -> Layout:
        """Layout of a critic, whose last inputs are the action."""
        inputs, *hidden, _ = self.policy_layout.sizes
        return Layout((inputs + self.action_size, *hidden, 1), self.action_size)

    def explore(self, observations: Tensor, noise: Tensor) -> Tensor:
        """Returns sampled actions (..., N, action_size) of a stochastic policy.

        Args:
            observations: (..., N, inputs).
            noise: (..., N, action_size) standard normal numbers.
        """
        raise NotImplementedError

    def pretraining(self, control_steps: int) -> int:
        """Returns the number of `pretrain` calls before the first update.

        Args:
            control_steps: made by the seed before the first update.
        """
        return 0

    def pretrain(self, batch: Batch) -> None:
        """Trains features on a minibatch before the first update of the agent."""
        raise NotImplementedError

    def is_delayed_update(self, update: int, update_of_call: int) -> bool:
        """Returns whether an update includes the parts that TD3 and SAC update less often.

        Args:
            update: number since the start of training, counted from 1.
            update_of_call: number within the current learning phase, counted from 0.
        """
        return True

    def update(self, batch: Batch, delayed: bool = True) -> None:
        """Makes one update from a minibatch of N transitions (s, a, r, s').

        Args:
            batch: its actions and next actions are overwritten.
            delayed: whether to include the delayed updates; see `is_delayed_update`.
        """
        raise NotImplementedError

    def _critics(
        self, names: Sequence[str], workspaces: Sequence[str], learned: bool = True
    ) -> list[Network]:
        """Returns critics; each forward pass evaluates the first one before the others."""
        return [
            self._network(name, self.critic_layout, workspace, learned)
            for name, workspace in zip(names, workspaces, strict=True)
        ]

    def _twins(self, workspaces: Sequence[str], suffix: str = "", learned: bool = True) -> Twins:
        """Returns two critics, saved as critic1 and critic2 with a suffix."""
        names = [f"critic{i}{suffix}" for i in (1, 2)]
        networks = self._critics(names, workspaces, learned)
        pairs = zip(names, networks, strict=True)
        return Twins(networks, [self._adam(*pair) for pair in pairs] if learned else ())


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
        bound = 1 / math.sqrt(inputs) if kind == "fan-in" else math.sqrt(6 / (inputs + outputs))
        if last_bound is not None and i == len(layers) - 1:
            bound = last_bound
        for parameters in (weight, bias) if kind == "fan-in" else (weight,):
            values = torch.empty(parameters.shape, dtype=parameters.dtype)
            parameters.copy_(torch.nn.init.uniform_(values, -bound, bound, generator=generator))


def sum_over_actions(values: Tensor) -> Tensor:
    """Returns the sum (..., 1) of values (..., action_size), the values themselves if it is 1."""
    return values if values.shape[-1] == 1 else values.sum(dim=-1, keepdim=True)


def tanh_gradient(gradient: Tensor, outputs: Tensor) -> Tensor:
    """Returns the gradient by the inputs of tanh: gradient * (1 - outputs^2)."""
    by_inputs: Tensor = torch.ops.aten.tanh_backward(gradient, outputs)
    return by_inputs
