"""What settings share whose algorithm is known only by a label."""

import re
from typing import Any

from pydantic import Field, field_validator

from jbench.names import FULL
from jbench.settings.base import Seed, Settings, in_id

LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
"""Labels of algorithms and representations: part of an id, so valid as names of directories."""


class LabeledSettings(Settings):
    """Base class of the settings of recorded training loops and of imported learning curves."""

    task: str
    algo: str = Field(description="label of the algorithm, such as cleanrl-td3")
    representation: str = Field(
        default=FULL, description="label of what the agent observes: full, or one such as dae12"
    )
    seed: Seed

    @field_validator("task")
    @classmethod
    def _is_a_name(cls, task: str) -> str:
        if not LABEL.fullmatch(in_id(task)):
            raise ValueError("type the name of a task, such as face_direction")
        return task

    @field_validator("algo", "representation")
    @classmethod
    def _fits_into_an_id(cls, label: str) -> str:
        if not LABEL.fullmatch(label):
            raise ValueError("type letters, digits, '.', '-' and '_', such as cleanrl-td3")
        return label

    @property
    def id(self) -> str:
        """The id, such as face_direction/cleanrl-td3/full/s03-1f9a2c4e."""
        return f"{in_id(self.task)}/{self.algo}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def values(self) -> dict[str, Any]:
        """The settings as a manifest records them."""
        return self.model_dump(mode="json")
