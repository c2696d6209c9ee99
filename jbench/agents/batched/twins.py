"""Two critics of the same input, as TD3 and SAC have."""

from collections.abc import Sequence

import torch
from torch import Tensor

from jbench.agents.batched.adam import Adam
from jbench.agents.batched.network import Network


class Twins:
    """Two networks with the same layers and inputs, evaluated and fitted together.

    In a stack they may be one network of twice as many seeds, those of the second critic after
    those of the first. This halves the kernels, and each of them occupies more of a GPU.

    Attributes:
        networks: both networks, or the joint one.
        first: the first network alone.
    """

    def __init__(
        self, networks: Sequence[Network], adams: Sequence[Adam] = (), first: Network | None = None
    ) -> None:
        """Wraps networks.

        Args:
            networks: two, or a joint one.
            adams: their optimizers; none for target networks.
            first: a view of the first of joint networks.
        """
        self.networks, self._adams = networks, adams
        self.first = first or networks[0]
        self._joint = len(networks) == 1

    def forward(self, inputs: Tensor) -> Sequence[Tensor]:
        """Returns the values (..., N, 1) of both for inputs (..., N, any)."""
        inputs = self._for_each(inputs)
        return self._of_each([network.forward(inputs) for network in self.networks])

    def fit(self, inputs: Tensor, targets: Tensor, scale: float) -> Tensor:
        """Makes a step of each towards targets y, (..., N, 1).

        Args:
            scale: c in the gradient c (Q(s, a) - y) / N of the loss by the values.

        Returns:
            (..., N, 1) the sum of the squared errors before the step.
        """
        inputs, targets = self._for_each(inputs), self._for_each(targets)
        all_errors = []
        for network, adam in zip(self.networks, self._adams, strict=True):
            errors = network.forward(inputs) - targets
            network.backward(errors * (scale / errors.shape[-2]))
            adam.step()
            all_errors.append(errors)
        first, second = self._of_each(all_errors)
        return first.square().addcmul_(second, second)

    def action_gradient(self, by_first: Tensor, by_second: Tensor) -> Tensor:
        """Returns the gradient of a loss by the actions, (..., N, action_size), after `forward`.

        Args:
            by_first: (..., N, 1) gradient of the loss by the values of the first.
            by_second: that of the second.
        """
        deltas = [torch.cat([by_first, by_second])] if self._joint else [by_first, by_second]
        pairs = zip(self.networks, deltas, strict=True)
        first, second = self._of_each([net.action_gradient(delta) for net, delta in pairs])
        return first.add_(second)

    def polyak_update(self, networks: "Twins", tau: float) -> None:
        """See `Network.polyak_update`."""
        for target, network in zip(self.networks, networks.networks, strict=True):
            target.polyak_update(network, tau)

    def _for_each(self, batch: Tensor) -> Tensor:
        """Returns a batch (..., N, any) as the networks take it."""
        return batch.repeat(2, 1, 1) if self._joint else batch

    def _of_each(self, outputs: Sequence[Tensor]) -> Sequence[Tensor]:
        """Returns what belongs to each critic of the outputs of the networks."""
        return outputs[0].chunk(2) if self._joint else outputs
