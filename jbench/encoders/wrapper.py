"""Agents on the latents of an encoder: their actions, environment and mirrored inputs."""

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from jbench.arrays import Array
from jbench.encoders.saved import Encoder
from jbench.errors import RequestError
from jbench.tasks.find import find_task

_MIRRORED = 64  # random observations from which the mirror of latents is found
_TOLERANCE = 1e-4  # relative to the range of an input; encoders are stored in float32


def action_signs(encoder: Encoder | None, observations: Array) -> Array | None:
    """Returns what the actions of a policy on an encoder's latents are multiplied by for the robot.

    For observations (..., dim(O)), these are (..., 1), -1 where the encoder encodes the mirror
    image; None for an encoder without `action_signs` or None, the full observation.
    """
    method = getattr(encoder, "action_signs", None)
    if method is None:
        return None
    return method(observations)


def on_observations(encoder: Encoder | None, act: Callable[[Array], Array]) -> Callable[..., Array]:
    """Returns a policy on observations (..., dim(O)), given one on the latents of an encoder."""
    if encoder is None:
        return act

    def act_on_observations(observations: Array) -> Array:
        """Returns the actions of the latents, for the robot as it is."""
        actions = act(encoder.encode(observations))
        signs = action_signs(encoder, observations)
        if signs is None:
            return actions
        return actions * signs

    return act_on_observations


class EncodedObservation(
    gymnasium.ObservationWrapper[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]
):
    """An environment whose observations are the latents of an encoder (paper, Figure 2).

    Where the encoder has mirrored the last observation, the robot gets the negated action.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], encoder: Encoder) -> None:
        """Wraps an environment; observations of another size than the encoder's: RequestError."""
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
        size = (encoder.latent_size,)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, size, np.float32)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, bool, bool, dict[str, Any]]:
        """Makes a control step with an action of a policy on the latents."""
        if self._sign < 0:
            action = np.negative(action)
        return super().step(action)

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Encodes an observation, on which the next action depends."""
        signs = action_signs(self._encoder, observation)
        self._sign = 1.0 if signs is None else float(signs[0])
        return np.asarray(self._encoder.encode(observation), np.float32)


class InputMirror(NamedTuple):
    """What a mirror does to an agent's inputs (size,): the image is gain * inputs + offset."""

    gain: NDArray[Any]
    offset: NDArray[Any]


def input_mirror(task: str, encoder: Encoder | None) -> InputMirror:
    """Returns the mirror of the inputs of an agent, which are the latents of an encoder, if any.

    An encoder needs no method for it: the mirror is found by encoding random observations and
    their mirror images. A mirror that acts on each input alone either keeps it or reflects it.

    Raises:
        RequestError: if no mirror image of the robot is known, a mirror mixes its latents, or the
            encoder encodes mirror images itself.
    """
    signs = find_task(task).mirror()
    if signs is None:
        raise RequestError(f"No mirror image is known of {task}: mirror must be false.")
    if encoder is None:
        return InputMirror(signs, np.zeros_like(signs))

    shape = _MIRRORED, len(signs)
    random = torch.Generator().manual_seed(0)
    observations = 2 * torch.rand(shape, dtype=torch.float64, generator=random) - 1
    if action_signs(encoder, observations) is not None:
        raise RequestError(
            "mirror=true is not for agents on an encoder that mirrors observations itself, such as "
            "planar-mirror: leave it out, or choose planar."
        )

    inputs = encoder.encode(observations)
    images = encoder.encode(observations * torch.from_numpy(signs))
    keeps = (images - inputs).abs().amax(0) < (images + inputs).var(0).sqrt()
    gain = torch.where(keeps, 1.0, -1.0)
    rest = images - gain * inputs
    offset = torch.where(keeps, 0.0, rest.mean(0))
    width = inputs.amax(0) - inputs.amin(0)
    if bool(((rest - offset).abs().amax(0) > _TOLERANCE * width).any()):
        raise RequestError(
            "mirror=true needs inputs of which a mirror changes only signs, such as those of full, "
            "scaled or planar, and this encoder mixes them: leave it out, or choose one of these."
        )

    return InputMirror(gain.numpy(), offset.numpy())
