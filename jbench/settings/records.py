"""Base classes of the settings of runs, and the settings of all other records."""

import re
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from jbench.errors import RequestError
from jbench.names import MAX_COUNT, ImportFormat, ReturnsName, TimeLimit
from jbench.representation_names import FULL, OFE
from jbench.settings.base import (
    Count,
    RecordSettings,
    Seed,
    Settings,
    in_id,
    omissible,
    settings_with,
    typed,
)
from jbench.settings.specs import Specs, episode_steps
from jbench.typed_values import known


class OFESettings(Settings):
    """Two networks that learn to predict the next observation, in front of actor and critics."""

    units: int = Field(
        ge=2,
        le=1000,
        description="features of each network; if there are no more than observation dimensions, "
        "the agent observes only them, else the observation followed by them",
    )
    layers: Count = Field(6, description="layers that the units are spread over; the authors' code")
    learning_rate: float = Field(3e-4, gt=0, description="Adam; the authors' code")
    pretraining: float = Field(
        1.0,
        ge=0,
        description="feature updates per control step before the agent's first update, all made "
        "just before it; the authors' code",
    )
    standardize_updates: Count = Field(
        10_000,
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


def requested_ofe(name: str, options: Mapping[str, Any]) -> OFESettings | None:
    """Returns the settings of a representation such as ofe12, or None for any other.

    Raises a RequestError if the number is missing, or a setting is unknown or invalid.
    """
    match = re.fullmatch(rf"{OFE}:?([0-9]*)", name)
    if match is None:
        return None
    if not match[1]:
        raise RequestError(f"{name} needs a number of features: type {OFE}12 or {OFE}240.")

    for option in options:
        known(f"setting of {OFE}", option, [n for n in OFESettings.model_fields if n != "units"])

    units = int(match[1].lstrip("0")[:10] or 0)
    return settings_with(OFESettings, name, {**options, "units": units})


def dataset_robot(task: str, specs: Specs | None) -> dict[str, Any]:
    """Returns the fields of `DatasetSettings` that describe the robot of a task."""
    return {} if specs is None else {"robot": task, "specs": specs}


JITTERBUG = "jitterbug"  # robot of a dataset that serves all five tasks

_AUGMENT = "seed of an augmented robot (default: the plain robot)"


class DatasetSettings(RecordSettings):
    """Settings that identify a dataset."""

    policy: str = "random"
    robot: str = Field(JITTERBUG, description="or the name of a task of another robot")
    specs: Specs | None = omissible(None, description="of a task of another robot")
    seed: Seed = Field(0, description="random seed")
    steps: int = Field(
        5_000_000,
        gt=0,
        description="number of control steps (paper, section 5.2: 5 million): whole episodes, or "
        "exactly as many where episodes may end early",
        json_schema_extra={"unit": "control steps"},
    )
    augment: Seed | None = omissible(None, description=_AUGMENT)

    @property
    def episode_steps(self) -> int:
        """Control steps of an episode, or most of them if episodes may end early."""
        return episode_steps(self.specs)

    @property
    def robot_in_words(self) -> str:
        """The option or the name that chooses the robot; `plain` for the plain Jitterbug."""
        if self.augment is not None:
            return f"--augment {self.augment}"
        return "plain" if self.specs is None else self.robot

    @property
    def id(self) -> str:
        """The dataset's id, such as random/s00-1f9a2c4e or dmc.cheetah-run/random/s00-59ba1e20."""
        robot = "" if self.specs is None else f"{in_id(self.robot)}/"
        return f"{robot}{self.policy}/s{self.seed:02d}-{self.hash}"


class EvaluationSettings(RecordSettings):
    """Settings that identify an evaluation."""

    task: str
    specs: Specs | None = omissible(None, description="of a task of another robot")
    policy: str = Field(description="as typed by the user, such as heuristic; of a file, its name")
    episodes: Count = Field(100, description="number of episodes")
    seed: Seed = Field(0, description="random seed of poses, targets and actions")
    states: bool = Field(False, description="record the state at every control step")
    target_yaw: float | None = Field(None, description="rad; None: drawn by the task")
    augment: Seed | None = Field(None, description=_AUGMENT)
    code: str | None = omissible(
        None, description="package and version of an imported policy, or its file's SHA-256"
    )
    sources: str | None = omissible(None, description="checksum of the code of an imported policy")
    accepted: str | None = omissible(
        None, description="checksum of the code that ran instead of the policy's recorded one"
    )

    @property
    def episode_steps(self) -> int:
        """Control steps of an episode."""
        return episode_steps(self.specs)

    @property
    def id(self) -> str:
        """The evaluation's id, such as move_to_pose/heuristic/s00-1f9a2c4e."""
        name = in_id(self.policy).replace("/", ".")
        return f"{in_id(self.task)}/{name}/s{self.seed:02d}-{self.hash}"


LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""Labels of algorithms and representations: part of an id, so valid as names of directories."""

_TASK_IN_AN_ID = re.compile(r"\w[\w.-]{0,199}(/\w[\w.-]{0,199})*", re.ASCII)
"""Tasks in ids, with a directory for each namespace, as in gym.ALE/Pong-v5."""


class Labels(Settings):
    """Task, algorithm and representation of a run or an imported curve."""

    task: str
    algo: str = Field(description="label of the algorithm, such as cleanrl-td3")
    representation: str = Field(
        FULL, description="label of what the agent observes: full, or one such as dae12"
    )

    @field_validator("task", "algo", "representation")
    @classmethod
    def _fits_into_an_id(cls, label: str, info: ValidationInfo) -> str:
        """Raises a ValueError if a label is no name of a directory, or a task of several."""
        is_task = info.field_name == "task"
        if is_task and not _TASK_IN_AN_ID.fullmatch(in_id(label)):
            raise ValueError("type the name of a task, such as face_direction")
        if not is_task and not LABEL.fullmatch(label):
            raise ValueError("type letters, digits, '.', '-' and '_', such as cleanrl-td3")
        return label


class LabeledSettings(Labels, RecordSettings):
    """Base class of the settings of runs, recorded training loops and imported curves."""

    seed: Seed

    @property
    def id(self) -> str:
        """The id, such as face_direction/cleanrl-td3/full/s03-1f9a2c4e."""
        configuration = f"{in_id(self.task)}/{in_id(self.algo)}/{self.representation}"
        return f"{configuration}/s{self.seed:02d}-{self.hash}"


class TrainedSettings(LabeledSettings):
    """Base class of the settings of runs: what all of them record."""

    specs: Specs | None = omissible(None, description="of a task of another robot")
    encoder: str | None = Field(None, description="id of the encoder")
    steps: Count = typed(
        5_000_000,
        unit="control steps",
        description="control steps of each run, over all environments, such as 100k or 5e6",
    )
    time_limit: TimeLimit = Field(
        "bootstrap",
        json_schema_extra={"typed": None},
        description="treat the time limit as a truncation (bootstrap) or as terminal (terminal) "
        "(default: bootstrap, and terminal with --settings figure8)",
    )
    evaluate_every: Count = typed(
        None,
        unit="control steps",
        description="control steps between evaluations (default: about a tenth of --steps, in "
        "whole episodes, at most 50,000)",
    )
    evaluate_episodes: int = typed(
        None,
        ge=0,
        le=MAX_COUNT,
        description="episodes per evaluation, 0 for none (default: 10, or fewer in a run of less "
        "than 200 episodes, so that evaluations take no longer than the training)",
    )
    hyperparameters: dict[str, Any] = Field(description="of the algorithm: JSON values by name")
    augment: Seed | None = omissible(
        None, description="seed of an augmented robot, or of the first of several"
    )

    @property
    def episode_steps(self) -> int:
        """Control steps of an episode."""
        return episode_steps(self.specs)

    @model_validator(mode="after")
    def _has_the_robot(self) -> Self:
        """Raises a ValueError if augmented robots are asked for of a robot that has none."""
        if self.specs is not None and self.augment is not None:
            given = " and ".join(sorted({"augment", "robots"} & self.model_fields_set))
            raise ValueError(f"{self.task} has no augmented robots: leave {given} out")
        return self


EXTERNAL: Literal["external"] = "external"  # the engine of these runs


class ExternalSettings(TrainedSettings):
    """Settings that identify a run that `jbench.record` writes.

    jbench knows neither the algorithm nor its hyperparameters: both are recorded as given.
    """

    robots: ClassVar[int] = 1
    engine: Literal["external"] = EXTERNAL


class ImportSettings(LabeledSettings):
    """Settings that identify an import: the content of its files and how they were read."""

    format: ImportFormat
    returns: ReturnsName
    files: list[str] = Field(min_length=1, description="SHA-256 of each file")
    columns: dict[str, str] = omissible(
        {}, description="columns or tags of the file that were read: steps, return, seed"
    )
