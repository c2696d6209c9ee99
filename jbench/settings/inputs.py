"""Settings of inputs that are standardized by running statistics."""

from typing import Literal, Self

from pydantic import model_validator

from jbench.settings.base import Settings, omissible

Normalization = Literal["none", "running"]


class InputSettings(Settings):
    """How an agent of the batched engine sees its observations, or latents of them."""

    normalize: Normalization = omissible(
        "none",
        description="running: the networks see (observation - mean) / sd, with the mean and the "
        "standard deviation of all observations on which the agent has acted (latents, if there is "
        "an encoder); as VecNormalize of stable-baselines3",
    )
    normalize_clip: float = omissible(
        5.0, gt=0, description="bound of a standardized number; stable-baselines 2"
    )
    normalize_min_sd: float = omissible(
        0.0,
        ge=0,
        description="least standard deviation, in the units of the observation: smaller ones count "
        "as this; stable-baselines 2: 0.1",
    )
    normalize_epsilon: float = omissible(
        1e-8, ge=0, description="added to the variance; stable-baselines3 (stable-baselines 2: 0)"
    )
    normalize_start_count: float = omissible(
        1e-4,
        gt=0,
        description="observations that the first mean of 0 and the first variance of 1 count as; "
        "stable-baselines3 (stable-baselines 2: 0.01)",
    )

    @model_validator(mode="after")
    def _has_a_deviation(self) -> Self:
        if self.normalize != "none" and self.normalize_min_sd == self.normalize_epsilon == 0:
            raise ValueError(
                "a constant number can't be standardized without normalize_min_sd or "
                "normalize_epsilon: one of them must be above 0"
            )
        return self
