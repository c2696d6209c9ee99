"""Settings of DDPG."""

from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat, model_validator

from jbench.names import SettingsBase
from jbench.settings.algorithms.base import (
    EVERY_STEP,
    SUITE_OFF_POLICY,
    Changes,
    DeterministicSettings,
    Fraction,
    Noise,
    changed,
)
from jbench.settings.base import Count, omissible

_SCRIPT: Changes = {
    "initialization": "glorot",
    "action_layer": 1,
    "last_layer_bound": 3e-3,
    "gradients_first": True,
}


class DDPGSettings(DeterministicSettings):
    """DDPG (Lillicrap et al., 2015)."""

    learner: ClassVar[str] = "ddpg:DDPGLearner"

    bases: ClassVar[Mapping[SettingsBase, Changes]] = {
        "published": {},
        "script": _SCRIPT,
        "figure8": {
            **_SCRIPT,
            "hidden_layers": [300, 300, 300],
            "batch_size": 64,
            "learning_starts": 64,  # a minibatch, so that the first update is at control step 100
            "normalize": "running",
            "normalize_min_sd": 0.1,
            "normalize_epsilon": 0.0,
            "normalize_start_count": 0.01,
        },
        "sb3": {**EVERY_STEP, "learning_starts": 100},
        "suite": {
            **SUITE_OFF_POLICY,
            "learning_rate": 1e-3,
            "action_noise": "normal",
            "noise_sigma": 0.1,
        },
    }

    # Updates begin as soon as a batch can be sampled; the policy acts from the first step.
    learning_starts: NonNegativeInt = changed(
        DeterministicSettings, "learning_starts", 256, "stable-baselines 2: a minibatch"
    )
    uniform_warmup: bool = changed(
        DeterministicSettings, "uniform_warmup", False, "stable-baselines 2"
    )
    train_freq: Count = changed(DeterministicSettings, "train_freq", 100, "stable-baselines 2")
    gradient_steps: Count = changed(
        DeterministicSettings, "gradient_steps", 50, "stable-baselines 2"
    )
    tau: Fraction = changed(DeterministicSettings, "tau", 0.001, "stable-baselines 2")
    action_noise: Noise = changed(
        DeterministicSettings, "action_noise", "ornstein-uhlenbeck", "Table 1"
    )
    noise_mean: float = changed(DeterministicSettings, "noise_mean", 0.3, "Table 1")
    noise_sigma: NonNegativeFloat = changed(DeterministicSettings, "noise_sigma", 0.3, "Table 1")
    action_layer: Literal[0, 1] = omissible(
        0,
        description="layer of the critic that takes the action, counted from 0; stable-baselines3 "
        "(script: 1)",
    )
    last_layer_bound: PositiveFloat | None = omissible(
        None,
        description="both output layers are initialized from U(-bound, bound), or for null like "
        "the other layers; stable-baselines3 (script: 0.003)",
    )
    gradients_first: bool = omissible(
        False,
        description="whether both gradients are computed before either step; stable-baselines3 "
        "(script: true)",
    )

    def obstacle_to_features(self) -> str:
        """See `Algorithm.obstacle_to_features`."""
        if self.action_layer:
            return "gives the critic features of observation and action: action_layer must be 0"
        return super().obstacle_to_features()

    @model_validator(mode="after")
    def _layer_exists(self) -> Self:
        """Raises a ValueError if the critic has no layer to which the action could go."""
        if self.action_layer > len(self.hidden_layers):
            raise ValueError("action_layer=1 needs a critic with hidden layers: it must be 0")
        return self
