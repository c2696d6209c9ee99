"""The settings of an import: the learning curve of one seed, made outside jbench."""

import re
from typing import Any

from pydantic import Field, field_validator

from jbench.names import FULL, MAX_SEED, TASKS, ImportFormat, ReturnsName
from jbench.settings.base import Settings, omissible

# Part of an id, so that it must be a valid name of a directory.
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


class ImportSettings(Settings):
    """What identifies an import: the content of its files and how they were read."""

    task: str
    algo: str = Field(description="label of the algorithm")
    representation: str = Field(default=FULL, description="label of what the agent observes")
    seed: int = Field(ge=0, le=MAX_SEED)
    format: ImportFormat
    returns: ReturnsName
    files: list[str] = Field(min_length=1, description="SHA-256 of each file")
    columns: dict[str, str] = omissible(
        {}, description="columns or tags of the file that were read: steps, return, seed"
    )

    @field_validator("task")
    @classmethod
    def _is_a_task(cls, task: str) -> str:
        if task not in TASKS:
            raise ValueError(f"choose {', '.join(TASKS)}")
        return task

    @field_validator("algo", "representation")
    @classmethod
    def _fits_into_an_id(cls, label: str) -> str:
        if not _LABEL.fullmatch(label):
            raise ValueError("type letters, digits, '.', '-' and '_', such as cleanrl-td3")
        return label

    @property
    def id(self) -> str:
        """The import's id, such as face_direction/cleanrl-td3/full/s03-1f9a2c4e."""
        return f"{self.task}/{self.algo}/{self.representation}/s{self.seed:02d}-{self.hash}"

    @property
    def values(self) -> dict[str, Any]:
        """The settings as a manifest records them."""
        return self.model_dump(mode="json")
