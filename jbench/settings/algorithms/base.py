"""Settings that several algorithms share, with stable-baselines3's names.

The defaults are the published settings. "Table 1" is the paper's; where it gives no number, the
paper used the defaults of stable-baselines 2 (section 5, Table 1), which differ from those of
stable-baselines3. Networks, first weights, forms of the losses and the first update are those of
stable-baselines3. A description says what a setting means, its unit, and after a semicolon the
source of its default.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, model_validator

from jbench.errors import RequestError
from jbench.names import EngineName, Precision, SettingsBase
from jbench.settings.algorithms.algorithm import Algorithm
from jbench.settings.base import Count, Settings, omissible

Fraction = Annotated[float, Field(gt=0, le=1)]
Discount = Annotated[float, Field(ge=0, le=1)]

Initialization = Literal["fan-in", "glorot"]
Noise = Literal["none", "normal", "ornstein-uhlenbeck"]
Normalization = Literal["none", "running"]

Changes = Mapping[str, Any]
"""Settings by name that differ from the published ones."""


@dataclass(frozen=True)
class Measurement:
    """A short training whose control steps take as long as those of a run.

    Attributes:
        changes: hyperparameters by name that make it short.
        first: control steps until the first updates have been made, which may take longer.
        rollout: control steps after these that are measured.
    """

    changes: dict[str, Any]
    first: int
    rollout: int


def changed(kind: type[Settings], name: str, default: Any, source: str) -> Any:
    """Returns a field of a class with another default, which has another source."""
    meaning, _, _ = str(kind.model_fields[name].description).rpartition("; ")
    return Field(default, description=f"{meaning}; {source}")


class AlgorithmSettings(Algorithm):
    """Settings of jbench's own algorithms, and of rules of other packages.

    Attributes:
        learner: the update rule in `jbench.agents.batched`, as MODULE:CLASS, since its import takes
            seconds; rules of other packages have no such name.
        bases: sources of hyperparameters, and in what each differs from the published ones.
    """

    learner: ClassVar[str]
    bases: ClassVar[Mapping[SettingsBase, Changes]] = {}
    precisions: ClassVar[tuple[Precision, ...]] = ("float32", "tf32", "bfloat16")
    knows_rollouts: ClassVar[bool] = True
    shares_updates: ClassVar[bool] = True

    learning_rate: PositiveFloat = Field(1e-4, description="step size of Adam; Table 1")
    batch_size: Count = Field(256, description="size of a minibatch, in transitions; Table 1")
    gamma: Discount = Field(
        0.99, description="discount of the rewards of each further control step; section 4.2"
    )
    hidden_layers: tuple[Count, ...] = Field(
        (350, 250),
        strict=False,  # JSON has lists
        description="ReLU units of each hidden layer, in actor and critic; Table 1",
    )
    normalize: Normalization = omissible(
        "none",
        description="running: the networks see (observation - mean) / sd, with the mean and the "
        "standard deviation of all observations on which the agent has acted (latents, if there is "
        "an encoder); ours",
    )
    normalize_clip: PositiveFloat = omissible(
        5.0, description="bound of a standardized number, in sd; stable-baselines 2's DDPG"
    )
    normalize_min_sd: NonNegativeFloat = omissible(
        0.0,
        description="least standard deviation, in the units of the observation: smaller ones count "
        "as this; stable-baselines3 (stable-baselines 2: 0.1)",
    )
    normalize_epsilon: NonNegativeFloat = omissible(
        1e-8,
        description="added to the variance of an observation; stable-baselines3 "
        "(stable-baselines 2: 0)",
    )
    normalize_start_count: PositiveFloat = omissible(
        1e-4,
        description="number of observations that the first mean of 0 and the first variance of 1 "
        "count as; stable-baselines3 (stable-baselines 2: 0.01)",
    )

    @model_validator(mode="after")
    def _has_a_deviation(self) -> Self:
        """Raises a ValueError if a number that is always equal would be divided by 0."""
        if self.normalize != "none" and self.normalize_min_sd == self.normalize_epsilon == 0:
            raise ValueError(
                "a constant number can't be standardized without normalize_min_sd or "
                "normalize_epsilon: one of them must be above 0"
            )
        return self

    @classmethod
    def engines(cls, name: str) -> tuple[EngineName, ...]:
        """See `Algorithm.engines`."""
        return ("batched", "sb3")

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between learning phases."""
        raise NotImplementedError

    def rollout(self, environments: int) -> int:
        """See `Algorithm.rollout`."""
        return self.rollout_steps(environments) * environments

    def measurement(self, environments: int, device: str, updates: int) -> Measurement:
        """Returns how to measure its speed by about `updates` updates."""
        raise NotImplementedError

    def only_batched(self, chosen: Collection[str]) -> list[str]:
        """See `Algorithm.only_batched`; VecNormalize standardizes inputs."""
        in_vec_normalize = {"normalize", "normalize_clip", "normalize_epsilon"}
        not_there = self.omitted().keys() - in_vec_normalize
        return sorted(not_there.intersection(chosen))

    def without_effect(self) -> dict[str, str]:
        """See `Algorithm.without_effect`."""
        if self.normalize != "none":
            return {}
        of_running = ("clip", "min_sd", "epsilon", "start_count")
        return {f"normalize_{name}": "normalize=running" for name in of_running}

    def obstacle_to_features(self) -> str:
        """See `Algorithm.obstacle_to_features`."""
        if self.normalize == "none":
            return ""
        return (
            "standardizes its inputs itself: normalize must be none, or choose another "
            "representation"
        )


class OffPolicySettings(AlgorithmSettings):
    """Settings of DDPG, TD3, SAC and rules of other packages, whose defaults these are."""

    buffer_size: Count = Field(
        1_000_000, description="transitions that the replay buffer holds; Table 1"
    )
    learning_starts: NonNegativeInt = Field(
        100, description="control steps after which updates begin; stable-baselines 2"
    )
    uniform_warmup: bool = Field(
        True,
        description="whether actions are uniformly random until learning_starts, not the policy's; "
        "stable-baselines 2",
    )
    train_freq: Count = Field(
        1, description="control steps from one learning phase to the next; stable-baselines 2"
    )
    gradient_steps: Count = Field(1, description="updates in a learning phase; stable-baselines 2")
    tau: Fraction = Field(
        0.005,
        description="share of a network in the next version of its target network; "
        "stable-baselines 2",
    )
    action_noise: Noise = Field(
        "none", description="noise that is added to actions in training; Table 1"
    )
    noise_mean: float = Field(
        0.0, description="mean of the action noise, where actions are from -1 to 1; Table 1"
    )
    noise_sigma: NonNegativeFloat = Field(
        0.2,
        description="standard deviation of normal action noise, or diffusion of Ornstein-Uhlenbeck "
        "noise in 1/√s; Table 1",
    )
    noise_theta: NonNegativeFloat = Field(
        0.15, description="rate of Ornstein-Uhlenbeck noise towards its mean, in 1/s; Table 1"
    )
    noise_dt: PositiveFloat = Field(
        0.01, description="step of Ornstein-Uhlenbeck noise, in s; stable-baselines 2"
    )
    mirror: bool = omissible(
        False,
        description="whether half of each minibatch is mirrored: x to -x, the action negated; ours",
    )

    def first_update(self, environments: int = 1) -> int:
        """See `Algorithm.first_update`."""
        rollout = self.rollout(environments)
        return rollout * (self.learning_starts // rollout + 1)

    def rollout_steps(self, environments: int) -> int:
        """Returns the control steps of each environment between learning phases."""
        return max(1, self.train_freq // environments)

    @property
    def is_mirrored(self) -> bool:
        """See `Algorithm.is_mirrored`."""
        return self.mirror

    def without_effect(self) -> dict[str, str]:
        """See `Algorithm.without_effect`."""
        needed = super().without_effect()
        if self.action_noise != "ornstein-uhlenbeck":
            for name in ("noise_theta", "noise_dt"):
                needed[name] = "action_noise=ornstein-uhlenbeck"
        if self.action_noise == "none":
            for name in ("noise_mean", "noise_sigma"):
                needed[name] = "action_noise=normal"
        return needed

    def check_environments(self, environments: int) -> Self:
        """See `Algorithm.check_environments`."""
        self.schedule(environments)
        return self

    def measurement(self, environments: int, device: str, updates: int) -> Measurement:
        """See `AlgorithmSettings.measurement`: a schedule of the same ratio, but shorter."""
        steps, due = self.schedule(environments)
        most = max(1, due // updates)
        parts = max(n for n in range(1, most + 1) if steps % n == due % n == 0)
        often = {"train_freq": steps // parts * environments, "gradient_steps": due // parts}
        rollout = often["train_freq"] * math.ceil(updates / often["train_freq"])
        first = self.batch_size + rollout
        changes = {
            "buffer_size": first + rollout,
            "learning_starts": self.batch_size,
            **often,
        }
        return Measurement(changes, first, rollout)

    def schedule(self, environments: int) -> tuple[int, int]:
        """Returns the steps per environment between learning phases, and the updates per phase.

        More environments take fewer steps each, so the ratio of updates to control steps does not
        depend on their number. Raises a RequestError if the number of updates is not an integer.
        """
        steps = self.rollout_steps(environments)
        updates, remainder = divmod(self.gradient_steps * steps * environments, self.train_freq)
        if remainder:
            raise RequestError(
                f"{environments} environments can't share {self.gradient_steps} updates every "
                f"{self.train_freq} control steps: type a number of environments that divides "
                f"{self.train_freq}."
            )

        return steps, updates


class DeterministicSettings(OffPolicySettings):
    """Settings of DDPG and TD3, whose policies are deterministic."""

    learns_features: ClassVar[bool] = True

    initialization: Initialization = omissible(
        "fan-in",
        description="first weights: U(-b, b) with b = 1 / sqrt(inputs), for biases too (fan-in), "
        "or b = sqrt(6 / (inputs + outputs)) and zero biases (glorot); stable-baselines3 (script: "
        "glorot)",
    )


EVERY_STEP: Changes = {
    "uniform_warmup": True,
    "train_freq": 1,
    "gradient_steps": 1,
    "tau": 0.005,
}
"""The schedule of stable-baselines3 off policy."""

SUITE_OFF_POLICY: Changes = {
    **EVERY_STEP,
    "hidden_layers": [256, 256],
    "learning_starts": 1_000,
    "noise_mean": 0.0,
}
"""Of agents on other robots: two layers of 256 units and 1,000 random control steps."""
