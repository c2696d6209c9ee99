"""Settings of recorded runs, which another program or a newer version may have written."""

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic import ValidatorFunctionWrapHandler as Handler
from pydantic_core.core_schema import ValidationInfo

from jbench.settings.records import EXTERNAL, ExternalSettings
from jbench.settings.run import RunSettings


class Unreadable(BaseModel):
    """Recorded settings that `RunSettings` rejects: of another program, or of a newer version.

    A field that is not recorded, or has a wrong type, has its default.
    """

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    values: dict[str, Any] = Field(description="the settings as the manifest records them")
    task: str | None = None
    algo: str | None = None
    representation: str | None = None
    seed: int | float | None = None
    steps: int | float | None = None
    engine: str | None = None
    evaluate_episodes: int = 0
    hyperparameters: dict[str, Any] = {}
    augment: Any = RunSettings.model_fields["augment"].default
    robots: int = RunSettings.model_fields["robots"].default

    @field_validator("*", mode="wrap")
    @classmethod
    def _or_default(cls, value: Any, handler: Handler, info: ValidationInfo) -> Any:
        try:
            return handler(value)
        except ValidationError:
            return cls.model_fields[str(info.field_name)].default


Run = RunSettings | ExternalSettings | Unreadable


@lru_cache(maxsize=10_000)
def parse_run(text: str) -> Run:
    """Returns the settings of a run from the column `settings` of the table `runs`."""
    return read_run(json.loads(text))


def read_run(values: Mapping[str, Any]) -> Run:
    """Returns the settings of a run from its manifest."""
    kind = ExternalSettings if values.get("engine") == EXTERNAL else RunSettings
    try:
        return kind.model_validate(values)
    except ValidationError:
        named = {name: values[name] for name in Unreadable.model_fields if name in values}
        return Unreadable(**{**named, "values": dict(values)})
