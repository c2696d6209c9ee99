"""The mirror image of an agent's inputs, for minibatches that contain mirrored transitions."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from jbench.encoders.saved import Encoder, action_signs
from jbench.errors import RequestError
from jbench.tasks.features import by_dimension, mirrored, observation_size

_OBSERVATIONS = 64
_TOLERANCE = 1e-4  # relative to the range of an input; encoders are stored in float32


class InputMirror(NamedTuple):
    """An agent's inputs for a mirrored observation are gain * inputs + offset, each (size,)."""

    gain: NDArray[np.float64]
    offset: NDArray[np.float64]


def input_mirror(task: str, encoder: Encoder | None) -> InputMirror:
    """Returns the mirror of an agent's inputs.

    An encoder needs no method for it: the mirror is found by encoding random observations and
    their mirror images. A mirror that acts on each input alone either keeps it or reflects it.

    Args:
        encoder: None for the full observation.

    Raises:
        RequestError: if a mirror mixes its latents, or it encodes mirror images itself.
    """
    if encoder is None:
        signs = np.array(by_dimension(task, "mirror"), np.float64)
        return InputMirror(signs, np.zeros_like(signs))
    shape = _OBSERVATIONS, observation_size(task)
    random = torch.Generator().manual_seed(0)
    observations = 2 * torch.rand(shape, dtype=torch.float64, generator=random) - 1
    if action_signs(encoder, observations) is not None:
        raise RequestError(
            "mirror=true is not for agents on an encoder that mirrors observations itself, such as "
            "planar-mirror: leave it out, or choose planar."
        )
    inputs = encoder.encode(observations)
    images = encoder.encode(mirrored(task, observations))
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
