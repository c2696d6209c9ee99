"""What all settings share: a strict class, its identity, and the sentence for a wrong value."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from jbench.errors import RequestError


class Settings(BaseModel):
    """Values that can't change, of exactly these names and types."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @property
    def hash(self) -> str:
        """The hash that is part of an id."""
        return settings_hash(self.model_dump(mode="json"))

    @classmethod
    def omitted(cls) -> dict[str, Any]:
        """Returns what fields mean that are omitted at their defaults (`omissible`), by name."""
        fields = cls.model_fields.items()
        return {name: field.default for name, field in fields if field.exclude_if is not None}


def omissible(default: Any, **more: Any) -> Any:
    """Returns a field that is omitted at its default: records made before it keep their ids."""
    return Field(default=default, exclude_if=lambda value: value == default, **more)


def canonical_json(settings: Mapping[str, Any]) -> str:
    """Returns the one JSON text of these settings: sorted keys, no spaces, ASCII.

    Raises:
        ValueError: if a value is not a number (NaN) or infinite.
    """
    return json.dumps(settings, sort_keys=True, separators=(",", ":"), allow_nan=False)


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Returns the first 8 hexadecimal digits of the SHA-256 of the canonical JSON."""
    return hashlib.sha256(canonical_json(settings).encode()).hexdigest()[:8]


_Model = TypeVar("_Model", bound=BaseModel)


def validated(kind: type[_Model], whose: str, /, **values: object) -> _Model:
    """Returns a settings object.

    Args:
        kind: of settings.
        whose: what the settings belong to, for the error.
        values: of the settings by name.

    Raises:
        RequestError: if a value is invalid; one sentence that names it.
    """
    try:
        return kind(**values)
    except ValidationError as error:
        first = error.errors()[0]
        message = first["msg"].removeprefix("Value error, ").rstrip(".")
        name = ".".join(str(part) for part in first["loc"])
        field = kind.model_fields.get(name)
        # A title is the name that users know the field by.
        named = field.title if field is not None and field.title else name
        subject = f"{named} of {whose} can't be {first['input']!r}: " if name else ""
        raise RequestError(f"{subject}{message}.") from None
