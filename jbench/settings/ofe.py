"""Settings of features that are learned with the agent (Ota et al., 2020, arXiv:2003.01629)."""

from pydantic import Field, PositiveInt

from jbench.names import OFE
from jbench.settings.base import Settings


class OFESettings(Settings):
    """Two networks that learn to predict the next observation, in front of actor and critics."""

    units: int = Field(
        ge=2,
        le=1000,
        description="of each network; at most as many as the observation has numbers: the agent "
        "sees the units alone; more: the observation and behind it the units",
    )
    layers: PositiveInt = Field(default=6, description="that share the units; the authors' code")
    learning_rate: float = Field(default=3e-4, gt=0, description="of Adam; the authors' code")
    pretraining: float = Field(
        default=1.0,
        ge=0,
        description="updates of the features for each control step before the agent's first "
        "update, all made then; the authors' code",
    )
    standardize_updates: PositiveInt = Field(
        default=10_000,
        description="updates of the features whose minibatches define mean and standard deviation "
        "of the observations; both are fixed afterwards",
    )

    @property
    def representation(self) -> str:
        """What the agent sees, as it is part of a run's id: ofe12."""
        return f"{OFE}{self.units}"

    @property
    def widths(self) -> list[int]:
        """Units of each layer of a network, as equal as possible, the larger ones first."""
        layers = min(self.layers, self.units)
        return [self.units // layers + (i < self.units % layers) for i in range(layers)]
