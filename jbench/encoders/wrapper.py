"""A Gymnasium wrapper that encodes observations, and maps actions back to the robot."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from jbench.encoders.saved import Encoder, action_signs
from jbench.errors import RequestError


class EncodedObservation(
    gymnasium.ObservationWrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
):
    """An environment whose observations are the latents of an encoder (paper, Figure 2).

    Where the encoder has mirrored the last observation, the robot gets the negated action.
    """

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
        self._sign = 1.0
        self.observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (encoder.latent_size,), np.float32
        )

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, bool, bool, dict[str, Any]]:
        """Makes a control step with an action of a policy on the latents."""
        # Other actions are passed on as they are.
        return super().step(action if self._sign > 0 else np.negative(action))

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Encodes an observation, on which the next action depends."""
        signs = action_signs(self._encoder, observation)
        self._sign = 1.0 if signs is None else float(signs[0])
        return np.asarray(self._encoder.encode(observation), np.float32)
