"""The settings of a run: one agent, one task, one seed."""

from collections.abc import Mapping
from typing import Any, Self

from pydantic import BaseModel, Field, model_validator

from jbench import validation
from jbench.agents.ofe import OFESettings
from jbench.agents.settings import SETTINGS, AlgorithmSettings
from jbench.names import (
    EPISODE_STEPS,
    FULL,
    LARGEST_SEED,
    OFE,
    Engine,
    Precision,
    TimeLimit,
    kind_of,
)
from jbench.store import canonical_json, settings_hash


def but_seed(settings: Mapping[str, Any]) -> str:
    """Returns what is the same text for the settings of runs that differ in their seeds alone."""
    return canonical_json({**settings, "seed": None})


class RunSettings(BaseModel):
    """What a run is made of; the id is made from it."""

    model_config = validation.SETTINGS

    task: str
    algo: str
    representation: str = Field(
        default=FULL, description="full, what the encoder is, as dae12, or ofe12"
    )
    encoder: str | None = Field(default=None, description="id of the encoder")
    seed: int = Field(ge=0, le=LARGEST_SEED)
    steps: int = Field(gt=0, description="control steps over all environments; section 5.1: 5e6")
    engine: Engine = "batched"
    time_limit: TimeLimit = "bootstrap"
    evaluate_every: int = Field(gt=0, description="control steps between evaluations")
    evaluate_episodes: int = Field(
        ge=0, title="--evaluate-episodes", description="episodes in an evaluation"
    )
    hyperparameters: dict[str, Any] = Field(description="every setting of the algorithm")
    # These are left out while they have their defaults: a plain run keeps the id that it had.
    augment: int | None = Field(
        default=None,
        ge=0,
        le=LARGEST_SEED,
        exclude_if=lambda augment: augment is None,
        description="seed of the augmented robot, or of the first of several",
    )
    robots: int = Field(
        default=1,
        ge=1,
        title="--robots",
        exclude_if=lambda robots: robots == 1,
        description="augmented robots, one after the other, of seeds that follow each other",
    )
    precision: Precision = Field(
        default="float32",
        exclude_if=lambda precision: precision == "float32",
        description="of the batched engine's products",
    )
    parallel: int | None = Field(
        default=None,
        ge=1,
        title="--environments",
        exclude_if=lambda parallel: parallel is None,
        description="environments of each seed; None for the algorithm's own",
    )
    ofe: OFESettings | None = Field(
        default=None,
        exclude_if=lambda ofe: ofe is None,
        description="features that are learned with the agent; None for none",
    )

    @model_validator(mode="before")
    @classmethod
    def _first_of_several(cls, values: Any) -> Any:
        """Several robots are augmented ones; that they begin with seed 0 need not be said."""
        several = isinstance(values, dict) and values.get("robots", 1) != 1
        if several and values.get("augment") is None:
            return {**values, "augment": 0}
        return values

    @model_validator(mode="after")
    def _only_batched(self) -> Self:
        if self.engine != "sb3":
            return self
        if self.parallel is not None or self.precision != "float32":
            raise ValueError("--environments and --precision are for --engine batched")
        unknown = set(self.hyperparameters) & set(SETTINGS[self.algo].batched_defaults())
        if unknown:
            raise ValueError(
                f"stable-baselines3 has no {', '.join(sorted(unknown))}; type --engine batched, or "
                "leave out --settings script and these of --set"
            )
        return self

    @model_validator(mode="after")
    def _ppo_is_not_in_bfloat16(self) -> Self:
        # Its probability ratios would compare an old policy in float32 with a new one in bfloat16.
        if self.algo == "ppo" and self.precision == "bfloat16":
            raise ValueError("PPO does not learn in --precision bfloat16: type float32")
        return self

    @model_validator(mode="after")
    def _can_learn_features(self) -> Self:
        name = self.representation
        if (self.ofe is not None) != (kind_of(name) == OFE):
            raise ValueError(f"features that are learned with the agent are called {OFE}N")
        if self.ofe is None:
            return self
        if name != f"{OFE}{self.ofe.units}":
            raise ValueError(f"{self.ofe.units} features are called {OFE}{self.ofe.units}")
        if self.algo == "ppo":
            raise ValueError(
                f"{name} is for DDPG, TD3 and SAC: PPO keeps no transitions to learn features "
                "from; type --algo td3, or another --encoder"
            )
        if self.engine == "sb3":
            raise ValueError(f"{name} is for --engine batched: stable-baselines3 does not have it")
        if self.encoder is not None:
            raise ValueError(f"{name} learns from observations: it can't have an encoder, too")
        if self.hyperparameters.get("action_layer"):
            raise ValueError(
                f"{name} gives the critic features of observation and action: type "
                "--set action_layer=0"
            )
        return self

    @model_validator(mode="after")
    def _whole_episodes_on_each(self) -> Self:
        least = self.robots * self.environments * EPISODE_STEPS
        if self.robots > 1 and self.steps % least:
            up = (self.steps // least + 1) * least
            each = f" in each of {self.environments} environments" if self.environments > 1 else ""
            raise ValueError(
                f"--robots {self.robots} of --steps {self.steps}: each robot gets equally many "
                f"episodes of {EPISODE_STEPS} control steps{each}: type --steps {up}, or another "
                f"multiple of {least}"
            )
        return self

    @property
    def id(self) -> str:
        """The run's id, such as face_direction/ddpg/dae12/s03-1f9a2c4e."""
        name = f"s{self.seed:02d}-{settings_hash(self.model_dump(mode='json'))}"
        return f"{self.task}/{self.algo}/{self.representation}/{name}"

    @property
    def algorithm(self) -> AlgorithmSettings:
        """The settings of the algorithm."""
        return SETTINGS[self.algo](**self.hyperparameters)

    @property
    def environments(self) -> int:
        """How many environments the agent learns in at a time."""
        return self.parallel or int(self.hyperparameters.get("n_envs", 1))

    @property
    def episodes_on_each(self) -> int:
        """How many episodes each environment has with each of the robots."""
        return self.steps // (self.robots * self.environments * EPISODE_STEPS)

    def robot_at(self, control_steps: int) -> int:
        """Returns which of the robots the given control step is made with, counted from 0.

        Args:
            control_steps: of the run, this step included. An algorithm may go on beyond `steps`, to
                the end of a rollout: that is with the last robot.
        """
        done = max(control_steps - 1, 0)
        return min(done * self.robots // self.steps, self.robots - 1)
