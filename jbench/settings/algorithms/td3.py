"""Settings of TD3."""

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field, NonNegativeFloat, NonNegativeInt

from jbench.names import SettingsBase
from jbench.settings.algorithms.base import (
    SUITE_OFF_POLICY,
    Changes,
    DeterministicSettings,
    Noise,
    changed,
)
from jbench.settings.base import Count


class TD3Settings(DeterministicSettings):
    """TD3 (Fujimoto et al., 2018)."""

    learner: ClassVar[str] = "td3:TD3Learner"

    bases: ClassVar[Mapping[SettingsBase, Changes]] = {
        "published": {},
        # The first update is at step 10,000, not one episode later.
        "script": {"initialization": "glorot", "learning_starts": 9_999},
        "sb3": {},
        "suite": {**SUITE_OFF_POLICY, "learning_rate": 1e-3, "noise_sigma": 0.1},
    }

    learning_starts: NonNegativeInt = changed(
        DeterministicSettings, "learning_starts", 10_000, "Table 1"
    )
    train_freq: Count = changed(DeterministicSettings, "train_freq", 1000, "Table 1")
    gradient_steps: Count = changed(DeterministicSettings, "gradient_steps", 1000, "Table 1")
    action_noise: Noise = changed(DeterministicSettings, "action_noise", "normal", "Table 1")
    policy_delay: Count = Field(
        2,
        description="updates of the critics for each update of actor and target networks; "
        "stable-baselines 2",
    )
    target_policy_noise: NonNegativeFloat = Field(
        0.2,
        description="standard deviation of the noise that is added to target actions; "
        "stable-baselines 2",
    )
    target_noise_clip: NonNegativeFloat = Field(
        0.5, description="bound of the absolute value of that noise; stable-baselines 2"
    )
