"""Settings of PPO."""

from collections.abc import Mapping
from typing import ClassVar, Literal, Self

from pydantic import Field, NonNegativeFloat, PositiveFloat

from jbench.errors import RequestError
from jbench.names import Precision, SettingsBase
from jbench.settings.algorithms.base import (
    AlgorithmSettings,
    Changes,
    Discount,
    Measurement,
    changed,
)
from jbench.settings.base import Count, omissible

_LIBRARY: Changes = {"n_epochs": 10, "clip_range_vf": None}


class PPOSettings(AlgorithmSettings):
    """PPO with a clipped objective (Schulman et al., 2017)."""

    learner: ClassVar[str] = "ppo:PPOLearner"

    # Its likelihood ratios would compare an old policy in float32 with a new one in bfloat16.
    precisions: ClassVar[tuple[Precision, ...]] = ("float32", "tf32")

    instead_of_environments: ClassVar[str] = "type n_envs, a setting of ppo"

    bases: ClassVar[Mapping[SettingsBase, Changes]] = {
        "published": {},
        "script": {
            "n_steps": 32,  # 256 over 8 environments
            "batch_size": 64,  # 4 minibatches
            "clip_range": 0.1,
            "clip_range_vf": 0.1,
            "value_loss": "max",
            "shared_layers": True,
            "vf_coef": 0.25,  # stable-baselines 2: 0.5 of half the squared error
        },
        "sb3": {**_LIBRARY, "batch_size": 256},  # Table 1's
        "suite": {
            **_LIBRARY,
            "hidden_layers": [64, 64],
            "batch_size": 64,
            "learning_rate": 3e-4,
            "ent_coef": 0.0,
        },
    }

    normalize_clip: PositiveFloat = omissible(
        10.0, description="bound of a standardized number, in sd; stable-baselines3"
    )
    n_envs: Count = Field(8, description="number of parallel environments; script")
    n_steps: Count = Field(
        256, description="control steps of each environment between updates; Table 1"
    )
    # stable-baselines 2 has no batch size for PPO but 4 minibatches: 8 * 256 / 4 transitions.
    batch_size: Count = changed(AlgorithmSettings, "batch_size", 512, "stable-baselines 2")
    n_epochs: Count = Field(
        4, description="passes over the transitions of a rollout; stable-baselines 2"
    )
    gae_lambda: Discount = Field(
        0.95,
        description="decay of longer returns in the estimate of an advantage; stable-baselines 2",
    )
    clip_range: PositiveFloat = Field(
        0.2,
        description="bound of the change of an action's likelihood ratio from 1; "
        "stable-baselines 2 (script: 0.1)",
    )
    clip_range_vf: PositiveFloat | None = Field(
        0.2,
        description="bound of the change of an estimated value, in returns, or null for none; "
        "stable-baselines 2 (script: 0.1)",
    )
    normalize_advantage: bool = Field(
        True,
        description="whether the advantages of a minibatch are standardized; stable-baselines 2",
    )
    ent_coef: NonNegativeFloat = Field(
        0.01, description="weight of the entropy in the loss, per nat; Table 1"
    )
    vf_coef: NonNegativeFloat = Field(
        0.5,
        description="weight of the squared error of the value in the loss; stable-baselines3 "
        "(script: 0.25, which is stable-baselines 2's 0.5 of half the squared error)",
    )
    max_grad_norm: PositiveFloat = Field(
        0.5,
        description="norm to which a longer gradient is shortened; stable-baselines 2",
    )
    shared_layers: bool = omissible(
        False,
        description="whether policy and value share their hidden layers; Table 1 (script: true)",
    )
    value_loss: Literal["clipped", "max"] = omissible(
        "clipped",
        description="squared error of the clipped value, or the maximum of those of the clipped "
        "and the unclipped; stable-baselines3 (script: max)",
    )

    @property
    def environments(self) -> int:
        """See `Algorithm.environments`."""
        return self.n_envs

    def without_effect(self) -> dict[str, str]:
        """See `Algorithm.without_effect`."""
        needed = super().without_effect()
        if self.clip_range_vf is None:
            needed["value_loss"] = "a number as clip_range_vf"
        return needed

    def check_stable_baselines3(self) -> Self:
        """See `Algorithm.check_stable_baselines3`."""
        least = min(self.batch_size, self.n_steps * self.n_envs)
        if self.normalize_advantage and least < 2:
            raise RequestError(
                "stable-baselines3 standardizes the advantages of at least two transitions: "
                "batch_size, and n_steps times n_envs, must be 2 or more, or normalize_advantage "
                "false."
            )
        return self

    def measurement(self, environments: int, device: str, updates: int) -> Measurement:
        """See `AlgorithmSettings.measurement`: a whole rollout, on a GPU the second one."""
        rollout = self.rollout(environments)
        if device == "cpu":
            return Measurement({}, 0, rollout)
        return Measurement({}, rollout, rollout)

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between updates, `n_steps` if `n_envs`."""
        return max(1, self.n_steps * self.n_envs // environments)
