"""Networks of ReLU units for actors and critics."""

import itertools
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor, nn

from jbench.settings.algorithms import Initialization


def mlp(
    sizes: Sequence[int],
    initialization: Initialization = "fan-in",
    last_layer_bound: float | None = None,
) -> nn.Sequential:
    """Returns linear layers with ReLU between them.

    Args:
        sizes: numbers of inputs, of units of each hidden layer, and of outputs.
        initialization: "fan-in" for torch's initial weights, or "glorot" for
            U(-b, b) with b = sqrt(6 / (inputs + outputs)) and zero biases (Glorot and Bengio,
            2010).
        last_layer_bound: bound of the last layer's uniform initial weights; None for the bound of
            the other layers.
    """
    layers = [nn.Linear(inputs, outputs) for inputs, outputs in itertools.pairwise(sizes)]
    initialize(layers, initialization, last_layer_bound)
    return nn.Sequential(*_with_relu(layers))


class JoiningCritic(nn.Module):
    """Layers of ReLU units, one of which takes the actions as further inputs."""

    def __init__(
        self,
        sizes: Sequence[int],
        action_size: int,
        action_layer: int,
        initialization: Initialization = "fan-in",
        last_layer_bound: float | None = None,
    ) -> None:
        """Makes the layers.

        Args:
            sizes: size of an observation, numbers of units of each hidden layer, and of outputs.
            action_size: size of an action.
            action_layer: layer that takes the actions, counted from 0.
            initialization: see `mlp`.
            last_layer_bound: see `mlp`.
        """
        super().__init__()
        self.observation_size = sizes[0]
        self.action_layer = action_layer
        layers = []
        for number, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
            joining = action_size if number == action_layer else 0
            layers.append(nn.Linear(inputs + joining, outputs))
        initialize(layers, initialization, last_layer_bound)
        self.layers = nn.ModuleList(layers)

    def forward(self, state_actions: Tensor) -> Tensor:
        """Returns values (N, 1) of observations and actions (N, observation_size + action_size)."""
        values = state_actions[:, : self.observation_size]
        actions = state_actions[:, self.observation_size :]
        for number, layer in enumerate(self.layers):
            if number > 0:
                values = values.relu()
            if number == self.action_layer:
                values = torch.cat([values, actions], dim=-1)
            values = layer(values)
        return values


def initialize(
    layers: Sequence[nn.Linear], kind: Initialization, last_layer_bound: float | None
) -> None:
    """Draws the initial weights of linear layers; see `mlp`. torch has drawn those of fan-in."""
    if kind == "glorot":
        for layer in layers:
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
    if last_layer_bound is not None:
        last = layers[-1]
        nn.init.uniform_(last.weight, -last_layer_bound, last_layer_bound)
        if kind == "fan-in":
            nn.init.uniform_(last.bias, -last_layer_bound, last_layer_bound)


def _with_relu(layers: Sequence[nn.Linear]) -> Iterator[nn.Module]:
    """Yields layers with ReLU between them."""
    *hidden, last = layers
    for layer in hidden:
        yield layer
        yield nn.ReLU()
    yield last
