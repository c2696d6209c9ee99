"""The settings of a run whose training loop is not part of jbench."""

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from jbench.names import MAX_COUNT, TimeLimit
from jbench.settings.base import Count, Seed, omissible
from jbench.settings.labeled import LabeledSettings
from jbench.settings.specs import Specs

EXTERNAL: Literal["external"] = "external"
"""The engine of these runs."""


class ExternalSettings(LabeledSettings):
    """Settings that identify a run that `jbench.record` writes.

    jbench knows neither the algorithm nor its hyperparameters: both are recorded as given.
    """

    encoder: str | None = Field(default=None, description="id of the encoder")
    steps: Count = Field(description="control steps over all environments")
    engine: Literal["external"] = EXTERNAL
    time_limit: TimeLimit = "bootstrap"
    evaluate_every: Count = Field(description="control steps between evaluations")
    evaluate_episodes: int = Field(ge=0, le=MAX_COUNT, description="episodes in an evaluation")
    hyperparameters: dict[str, Any] = Field(description="JSON values by name")
    augment: Seed | None = omissible(None, description="seed of the augmented robot")
    specs: Specs | None = omissible(None, description="of a task of another robot")

    @model_validator(mode="after")
    def _is_of_the_jitterbug(self) -> Self:
        if self.specs is not None and self.augment is not None:
            raise ValueError(f"{self.task} has no augmented robots: leave augment out")
        return self

    @property
    def robots(self) -> int:
        """Number of robots that are trained on in sequence."""
        return 1
