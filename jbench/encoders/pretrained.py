"""Base class of the kinds whose latents a trained torch module computes.

`docs/your-own-encoder.md` has an example.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from jbench.arrays import Array
from jbench.encoders.kind import Fitted
from jbench.encoders.networks import Weights
from jbench.encoders.states import States

_PREFIX = "module."  # of the names of parameters in `_Latents`


class TorchEncoder(Fitted):
    """A kind whose latents a trained torch module computes.

    The numbers of the `state_dict` are saved with the encoder, so that agents do not need its file.
    Saved are float32; integers, which these hold up to 2**24, and booleans get the module's type.
    """

    def module(self) -> torch.nn.Module:
        """Returns the module with any parameters: it makes the latents of scaled features."""
        raise NotImplementedError

    def state_dict(self) -> Mapping[str, Tensor]:
        """Returns the trained parameters and buffers of the module by name."""
        raise NotImplementedError

    def latents(self, module: torch.nn.Module, scaled: Tensor) -> Tensor:
        """Returns latents (..., latents) for scaled features (..., size), by default the output."""
        latents: Tensor = module(scaled)
        return latents

    def latent_sizes(self, task: str, features: int) -> range:
        """Returns the number of latents of the module, which it is asked for."""
        with torch.no_grad():
            size = self.latents(self.module().eval(), torch.zeros(1, features)).shape[-1]
        return range(size, size + 1)

    def fit(self, states: States, latents: int) -> dict[str, NDArray[Any]]:
        """Returns the trained parameters and buffers by name."""
        module = self.module()
        module.load_state_dict(self.state_dict())
        return {name: value.numpy(force=True) for name, value in module.state_dict().items()}

    def encode(self, weights: Weights, scaled: Array) -> Array:
        """Returns the latents (..., latents) of the module with the saved parameters."""
        if not isinstance(scaled, Tensor):
            return self.encode(weights, torch.from_numpy(scaled)).numpy()

        values = {
            name: _like(of_module, weights[name.removeprefix(_PREFIX)])
            for name, of_module in self._latents.state_dict().items()
        }
        with torch.no_grad():
            latents: Tensor = torch.func.functional_call(self._latents, values, (scaled,))
        return latents

    @cached_property
    def _latents(self) -> torch.nn.Module:
        """The module that makes latents; it is made once."""
        return _Latents(self)


def _like(of_module: Tensor, saved: Any) -> Tensor:
    """Returns saved numbers as a module computes with them: an index must stay an integer."""
    numbers = torch.as_tensor(saved)
    if of_module.is_floating_point():
        return numbers
    return numbers.to(of_module.dtype)


class _Latents(torch.nn.Module):
    """The function `latents` of a kind, as a module whose parameters can be replaced."""

    def __init__(self, kind: TorchEncoder) -> None:
        """Has the module of a kind, ready to act."""
        super().__init__()
        self._kind = kind
        self.module = kind.module().eval()

    def forward(self, scaled: Tensor) -> Tensor:
        """Returns the latents of scaled states."""
        return self._kind.latents(self.module, scaled)
