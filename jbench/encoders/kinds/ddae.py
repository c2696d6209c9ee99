"""The dynamic denoising autoencoder predicts the state some control steps later.

Source: the authors' code, in which it is the denoising autoencoder with another target.
"""

from typing import ClassVar

from pydantic import Field

from jbench.encoders.kinds.dae import DenoisingAutoencoder
from jbench.names import EPISODE_STEPS


class DynamicDenoisingAutoencoder(DenoisingAutoencoder):
    """Predicts the clean state `horizon` control steps later from a noisy one.

    Its error includes what is unpredictable, such as the effect of the random actions.
    """

    decodes_later: ClassVar[bool] = True

    horizon: int = Field(default=1, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    @property
    def steps_ahead(self) -> int:
        """Control steps to the predicted state."""
        return self.horizon
