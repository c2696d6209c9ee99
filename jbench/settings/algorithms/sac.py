"""Settings of SAC."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field, NonNegativeFloat

from jbench.names import SettingsBase
from jbench.settings.algorithms.base import (
    SUITE_OFF_POLICY,
    Changes,
    Noise,
    OffPolicySettings,
    changed,
)
from jbench.settings.base import Count


class SACSettings(OffPolicySettings):
    """SAC with a learned entropy coefficient (Haarnoja et al., 2018)."""

    learner: ClassVar[str] = "sac:SACLearner"

    learns_features: ClassVar[bool] = True

    bases: ClassVar[Mapping[SettingsBase, Changes]] = {
        "published": {},
        "sb3": {"target_entropy": "auto"},
        "suite": {
            **SUITE_OFF_POLICY,
            "target_entropy": "auto",
            "learning_rate": 3e-4,
            "action_noise": "none",
        },
    }

    action_noise: Noise = changed(OffPolicySettings, "action_noise", "normal", "Table 1")
    ent_coef: NonNegativeFloat | Literal["auto"] = Field(
        "auto",
        description="weight of the entropy against the return (temperature), or auto to learn it; "
        "stable-baselines 2",
    )
    target_entropy: float | Literal["auto"] = Field(
        -1.0,
        description="entropy of the policy at which a learned weight aims, in nats, or auto for "
        "minus the number of actions; stable-baselines 2",
    )
    target_update_interval: Count = Field(
        1, description="updates from one of the target networks to the next; stable-baselines 2"
    )

    def without_effect(self) -> dict[str, str]:
        """See `Algorithm.without_effect`."""
        needed = super().without_effect()
        if self.ent_coef != "auto":
            needed["target_entropy"] = "ent_coef=auto"
        return needed
