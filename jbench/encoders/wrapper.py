"""A Gymnasium wrapper that encodes observations."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from jbench.encoders.saved import Encoder
from jbench.errors import RequestError


class EncodedObservation(
    gymnasium.ObservationWrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
):
    """An environment whose observations are the latents of an encoder (paper, Figure 2)."""

    def __init__(self, env: gymnasium.Env[Any, Any], encoder: Encoder) -> None:
        """Wraps an environment; observations become (latent_size,) float32.

        Raises:
            RequestError: if the encoder is of observations of another size.
        """
        super().__init__(env)
        shape = env.observation_space.shape
        try:
            encoder.encode(np.zeros(shape or (), np.float32))
        except ValueError:
            raise RequestError(
                f"This encoder can't encode observations of shape {shape}; load one of the "
                "environment's task."
            ) from None
        self._encoder = encoder
        self.observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (encoder.latent_size,), np.float32
        )

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Encodes an observation."""
        return np.asarray(self._encoder.encode(observation), np.float32)
