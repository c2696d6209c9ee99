"""Settings of features that are learned with the agent (Ota et al., 2020, arXiv:2003.01629)."""

from pydantic import Field

from jbench.names import OFE
from jbench.settings.base import Count, Settings


class OFESettings(Settings):
    """Two networks that learn to predict the next observation, in front of actor and critics."""

    units: int = Field(
        ge=2,
        le=1000,
        description="features of each network; if there are no more than observation dimensions, "
        "the agent observes only them, else the observation followed by them",
    )
    layers: Count = Field(
        default=6, description="layers over which the units are spread; the authors' code"
    )
    learning_rate: float = Field(default=3e-4, gt=0, description="Adam; the authors' code")
    pretraining: float = Field(
        default=1.0,
        ge=0,
        description="feature updates per control step before the agent's first update, all made "
        "just before it; the authors' code",
    )
    standardize_updates: Count = Field(
        default=10_000,
        description="number of feature updates whose minibatches determine the observations' mean "
        "and standard deviation, which are fixed afterwards",
    )

    @property
    def representation(self) -> str:
        """Name of the representation in a run's id, such as ofe12."""
        return f"{OFE}{self.units}"

    @property
    def widths(self) -> list[int]:
        """Units of each layer of a network: equal up to one, larger layers first."""
        layers = min(self.layers, self.units)
        return [self.units // layers + (i < self.units % layers) for i in range(layers)]
