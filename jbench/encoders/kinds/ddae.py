"""The dynamic denoising autoencoder: it reconstructs the state some control steps later.

Source: the authors' code beside the paper, which tried it; their denoising autoencoder with
another target.
"""

from typing import ClassVar

from pydantic import Field

from jbench.encoders.kinds.dae import DenoisingAutoencoder
from jbench.names import EPISODE_STEPS


class DynamicDenoisingAutoencoder(DenoisingAutoencoder):
    """Foresees the clean state `horizon` control steps later from a noisy one.

    What it can't foresee, such as the random actions in between, stays in its error.
    """

    decodes_later: ClassVar[bool] = True

    horizon: int = Field(default=1, ge=1, lt=EPISODE_STEPS, description="control steps; ours")

    @property
    def steps_ahead(self) -> int:
        """Control steps to the state that is reconstructed."""
        return self.horizon
