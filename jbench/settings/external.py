"""The settings of a run whose training loop is not part of jbench."""

import re
from typing import Any, Literal

from pydantic import Field, field_validator

from jbench.names import FULL, MAX_SEED, TASKS, TimeLimit
from jbench.settings.base import Settings, omissible

EXTERNAL: Literal["external"] = "external"
"""The engine of these runs."""

LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""Names of algorithms that are not jbench's: part of an id, so valid as names of directories."""


class ExternalSettings(Settings):
    """What identifies a run that `jbench.record` writes.

    jbench knows neither the algorithm nor its hyperparameters: both are recorded as given.
    """

    task: str
    algo: str = Field(description="label of the algorithm, such as cleanrl-td3")
    representation: str = Field(default=FULL, description="full, or what the encoder is, as dae12")
    encoder: str | None = Field(default=None, description="id of the encoder")
    seed: int = Field(ge=0, le=MAX_SEED)
    steps: int = Field(gt=0, description="control steps over all environments")
    engine: Literal["external"] = EXTERNAL
    time_limit: TimeLimit = "bootstrap"
    evaluate_every: int = Field(gt=0, description="control steps between evaluations")
    evaluate_episodes: int = Field(ge=0, description="episodes in an evaluation")
    hyperparameters: dict[str, Any] = Field(description="JSON values by name")
    augment: int | None = omissible(
        None, ge=0, le=MAX_SEED, description="seed of the augmented robot"
    )

    @field_validator("task")
    @classmethod
    def _is_a_task(cls, task: str) -> str:
        if task not in TASKS:
            raise ValueError(f"choose {', '.join(TASKS)}")
        return task

    @field_validator("algo")
    @classmethod
    def _fits_into_an_id(cls, algo: str) -> str:
        if not LABEL.fullmatch(algo):
            raise ValueError("type letters, digits, '.', '-' and '_', such as cleanrl-td3")
        return algo

    @property
    def id(self) -> str:
        """The run's id, such as face_direction/cleanrl-td3/full/s03-1f9a2c4e."""
        return f"{self.task}/{self.algo}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def values(self) -> dict[str, Any]:
        """The settings as a manifest records them."""
        return self.model_dump(mode="json")

    @property
    def robots(self) -> int:
        """The number of robots that are learned on in turn."""
        return 1
