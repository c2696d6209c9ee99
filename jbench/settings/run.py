"""The settings of a run: one agent, one task, one seed."""

from typing import Any, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from jbench.names import EngineName, Precision
from jbench.representation_names import OFE, kind_in
from jbench.settings.algorithms import SETTINGS, Algorithm, Foreign, ForeignRule
from jbench.settings.base import omissible, validated
from jbench.settings.engines import ENGINES
from jbench.settings.records import LABEL, OFESettings, TrainedSettings


class RunSettings(TrainedSettings):
    """Settings that identify a run.

    To add a setting, add a field with a description: unless `TYPED` leaves it out, it is an option
    of `jbench train` and a key of a sweep, both called by its title if it has one. Make it
    omissible, so that existing runs keep their ids.
    """

    robots: int = omissible(
        1, ge=1, description="number of augmented robots to train on in sequence, from --augment on"
    )
    engine: EngineName = Field(
        "batched",
        json_schema_extra={"typed": None},
        description="training engine: batched (many seeds at a time) or sb3 (stable-baselines3) "
        "(default: batched, or the only engine of the algorithm)",
    )
    package: str | None = omissible(
        None, description="distribution of an agent or an update rule that is not jbench's"
    )
    sources: str | None = omissible(
        None, description="checksum of the code of an algorithm that is not jbench's"
    )
    accepted: str | None = omissible(
        None, description="checksum of the code that the run went on with, after another one"
    )
    precision: Precision = omissible(
        "float32",
        description="precision of the batched engine's matrix products: float32, bfloat16, or on a "
        "GPU tf32",
    )
    parallel: int | None = omissible(
        None,
        ge=1,
        title="environments",
        description="parallel environments per seed (default: those of the algorithm)",
    )
    ofe: OFESettings | None = omissible(None, description="features learned with the agent")
    encoder_draws: str | None = omissible(
        None, description="hash of the encoders' settings without seeds, if each seed has its own"
    )

    @model_validator(mode="before")
    @classmethod
    def _first_of_several(cls, values: Any) -> Any:
        """Several robots are always augmented robots; the first seed is 0 by default."""
        several = isinstance(values, dict) and values.get("robots", 1) != 1
        if several and values.get("augment") is None:
            return {**values, "augment": 0}
        return values

    @field_validator("algo")
    @classmethod
    def _fits_into_an_id(cls, label: str, info: ValidationInfo) -> str:
        """Replaces the check of labels: the algorithm may be MODULE:CLASS, and tasks are found."""
        if not LABEL.fullmatch(label.replace(":", ".", 1)):
            raise ValueError(f"choose {', '.join(SETTINGS)}, or the name of an installed agent")
        return label

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        """Raises a ValueError if the algorithm, its engine and the task do not fit each other."""
        algorithm = self.algorithm  # which checks the hyperparameters
        engines = algorithm.engines(self.algo)
        if self.engine not in engines:
            raise ValueError(
                f"{self.algo} has the engine {' or '.join(engines)}, not {self.engine}"
            )
        if self.specs is not None and algorithm.is_mirrored:
            raise ValueError(f"no mirror image is known of {self.task}: mirror must be false")
        if self.precision != "float32" and not ENGINES[self.engine].has_options:
            raise ValueError(
                "precision is a setting of the batched engine: leave it out, or choose that engine"
            )
        if self.precision not in algorithm.precisions:
            raise ValueError(
                f"{self.algo} does not learn in {self.precision}: precision must be float32"
            )

        if not ENGINES[self.engine].has_options:
            if self.parallel is not None and algorithm.shares_updates:
                raise ValueError(
                    "environments is a setting of the batched engine: choose that engine, or "
                    f"{algorithm.instead_of_environments}"
                )

            unknown = algorithm.only_batched([*self.hyperparameters])
            if unknown:
                raise ValueError(
                    f"stable-baselines3 has no {', '.join(unknown)}: choose the batched engine, or "
                    "other settings"
                )

        return self

    @model_validator(mode="after")
    def _shares_its_steps(self) -> Self:
        """Robots in sequence have as many whole episodes each."""
        if self.robots == 1:
            return self

        count = self.environments
        least = self.robots * count * self.episode_steps
        if self.steps % least:
            up = (self.steps // least + 1) * least
            length = f"{self.episode_steps} control steps"
            if count > 1:
                length += f" in each of {count} environments"

            raise ValueError(
                f"{self.robots} robots can't share {self.steps} steps equally, in episodes of "
                f"{length}: steps must be {up}, or another multiple of {least}"
            )

        return self

    @model_validator(mode="after")
    def _has_possible_features(self) -> Self:
        """Raises a ValueError if learned features do not fit the algorithm or their name."""
        name = self.representation
        if self.ofe is None:
            if kind_in(name) == OFE:
                raise ValueError(f"{name} needs the settings of its features, ofe")
            return self
        if name != self.ofe.representation:
            raise ValueError(
                f"{self.ofe.units} learned features are called {self.ofe.representation}"
            )

        if not (self.algorithm.learns_features and ENGINES[self.engine].has_options):
            # PPO keeps no transitions to learn features from.
            advice = "the engine batched" if self.algorithm.learns_features else "td3"
            raise ValueError(
                f"{name} is for DDPG, TD3 and SAC of the batched engine, not for {self.algo} of "
                f"the engine {self.engine}; choose {advice}, or another representation"
            )

        if self.encoder is not None:
            raise ValueError(f"{name} learns from observations: it can't have an encoder, too")

        obstacle = self.algorithm.obstacle_to_features()
        if obstacle:
            raise ValueError(f"{name} {obstacle}")

        return self

    @property
    def algorithm(self) -> Algorithm:
        """The settings of the algorithm; of another package's, only their names are checked."""
        kind = SETTINGS.get(self.algo)
        if kind is None:
            foreign = ForeignRule if ENGINES[self.engine].trains_rules else Foreign
            return foreign(hyperparameters=self.hyperparameters)
        return validated(kind, self.algo, **self.hyperparameters)

    @property
    def environments(self) -> int:
        """Number of parallel environments of the agent."""
        return self.parallel or self.algorithm.environments

    @property
    def replay_capacity(self) -> int | None:
        """Number of transitions that the agent's replay buffer holds; None without one of jbench's.

        All off-policy algorithms, those of other packages too, call this setting `buffer_size`.
        """
        if not ENGINES[self.engine].has_replay_buffers:
            return None
        return self.hyperparameters.get("buffer_size")

    @property
    def rollout(self) -> int:
        """Number of control steps between learning phases; 1 if it is unknown."""
        return self.algorithm.rollout(self.environments)

    @property
    def first_update(self) -> int:
        """Number of control steps before the first update; 0 if it is unknown."""
        return self.algorithm.first_update(self.environments)

    @property
    def last_step(self) -> int:
        """Number of control steps at the end: `steps`, or more to complete a rollout."""
        return -(-self.steps // self.rollout) * self.rollout

    @property
    def episodes_on_each(self) -> int:
        """Number of episodes of each environment with each robot."""
        return self.steps // (self.robots * self.environments * self.episode_steps)

    def robot_seed(self, robot: int) -> int | None:
        """Returns the seed of the augmented robot with this index, at most the last one."""
        if self.augment is None:
            return None
        return self.augment + min(robot, self.robots - 1)

    def robot_at(self, control_steps: int) -> int:
        """Returns the index of the robot at a control step, which is counted from 1.

        An algorithm may train beyond `steps` to the end of a rollout, with the last robot.
        """
        done = max(control_steps - 1, 0)
        return min(done * self.robots // self.steps, self.robots - 1)


_RESOLVED = {
    "task",
    "specs",
    "algo",
    "package",
    "sources",
    "accepted",
    "hyperparameters",
    "seed",
    "representation",
    "encoder",
    "encoder_draws",
    "ofe",
}
TYPED = tuple(name for name in RunSettings.model_fields if name not in _RESOLVED)
"""Fields that are options of `jbench train` and keys of a sweep; the others follow from these."""
