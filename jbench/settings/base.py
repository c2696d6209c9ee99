"""Base class of settings, its hash, and error messages for invalid values."""

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from jbench.errors import RequestError
from jbench.names import MAX_COUNT, MAX_SEED
from jbench.typed_values import closest, suggested

Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]
Count = Annotated[int, Field(ge=1, le=MAX_COUNT)]


class Settings(BaseModel):
    """An immutable model that accepts no other names or types than its fields."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _has_finite_numbers(cls, value: Any) -> Any:
        """Checks fields typed `Any`, too, which pydantic leaves out of `allow_inf_nan`."""
        if not _is_finite(value):
            raise ValueError("numbers must be finite")
        return value

    @property
    def values(self) -> dict[str, Any]:
        """The settings as a manifest records them."""
        return self.model_dump(mode="json")

    @property
    def hash(self) -> str:
        """The hash that is part of an id."""
        return settings_hash(self.values)

    @classmethod
    def omitted(cls) -> dict[str, Any]:
        """Returns the defaults of the `omissible` fields by name."""
        fields = cls.model_fields.items()
        return {name: field.default for name, field in fields if field.exclude_if is not None}


class RecordSettings(Settings):
    """Settings of a record, of which its id is made."""

    @property
    def id(self) -> str:
        """The id of the record."""
        raise NotImplementedError


def _is_finite(value: Any) -> bool:
    """Returns whether a value of JSON has no number that is infinite or NaN."""
    if isinstance(value, Mapping):
        return all(map(_is_finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def omissible(default: Any, **more: Any) -> Any:
    """Returns a field that is omitted at its default, so that older records keep their ids."""
    return Field(default, exclude_if=lambda value: value == default, **more)


def typed(default: Any, unit: str | None = None, **more: Any) -> Any:
    """Returns a field that every record has; users who type none get the default.

    A default of None is derived from other settings. The unit `control steps` may be typed as 100k
    or 5e6.
    """
    return Field(json_schema_extra={"typed": default, "unit": unit}, **more)


def typed_default(field: FieldInfo) -> Any:
    """Returns what users get who don't type a field."""
    return extra(field).get("typed", field.default)


def extra(field: FieldInfo) -> Mapping[str, Any]:
    """Returns what jbench adds to the schema of a field, such as its unit."""
    if isinstance(field.json_schema_extra, dict):
        return field.json_schema_extra
    return {}


def canonical_json(settings: Mapping[str, Any]) -> str:
    """Returns sorted, ASCII JSON without spaces; raises a ValueError if a value is not finite."""
    return json.dumps(settings, sort_keys=True, separators=(",", ":"), allow_nan=False)


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Returns the first 8 hexadecimal digits of the SHA-256 of the canonical JSON."""
    return hashlib.sha256(canonical_json(settings).encode()).hexdigest()[:8]


def in_id(name: str) -> str:
    """Returns a name such as dmc:cheetah-run as a part of an id, without colon, comma and =."""
    return re.sub("[:,=]", ".", name)


def task_and_representation(encoder: str) -> tuple[str, str]:
    """Returns what the id of an encoder begins with, such as face_direction and dae12.

    The task may have slashes, as gym:NAMESPACE/ID of Gymnasium's registry.
    """
    parts = encoder.rsplit("/", 2)
    return parts[0], parts[1]


def whole(value: Any) -> Any:
    """Returns the integer for a float such as 5e6, and anything else as it is."""
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


_Model = TypeVar("_Model", bound=BaseModel)

_PLAIN = {
    "Value error, ": "",
    "Input should": "it should",
    "Tuple should": "it should",
    "a valid integer": "a whole number",
    "a valid tuple": "a list in brackets",
    "a valid array": "a list in brackets",
    " after validation": "",
}
"""Words of pydantic's messages in those of settings."""


def validated(kind: type[_Model], whose: str, /, **values: object) -> _Model:
    """Returns a settings object; raises a RequestError that names the setting if one is invalid."""
    try:
        return kind(**values)
    except ValidationError as error:
        raise _refusal(error, kind, whose, "key", values) from None


def settings_with(
    kind: type[_Model], name: str, values: Mapping[str, object], noun: str = "setting"
) -> _Model:
    """Returns a settings object with values by name, as JSON values, instead of its defaults.

    An integer may be a float, such as 1e3. Raises a RequestError if a setting, called by the noun,
    is unknown or a value is invalid.
    """
    given = dict(values)
    for setting, field in kind.model_fields.items():
        if setting in given and field.annotation is int:
            given[setting] = whole(given[setting])

    try:
        return kind.model_validate_json(json.dumps(given, default=repr))
    except ValidationError as error:
        raise _refusal(error, kind, name, noun, given) from None


def _refusal(
    error: ValidationError,
    kind: type[BaseModel],
    whose: str,
    noun: str,
    values: Mapping[str, object],
) -> RequestError:
    """Returns an error whose message names the first invalid setting; see `settings_with`."""
    # An unknown name explains the other errors: it was meant to be another one.
    details = error.errors()
    first = min(details, key=lambda detail: detail["type"] != "extra_forbidden")
    location = _location(first, values)
    *tables, name = location or [""]
    if first["type"] == "extra_forbidden":
        for table in tables:
            kind = kind.model_fields[table].annotation  # type: ignore[assignment]
            whose = f"[{table}]"
        names = sorted(field.title or key for key, field in kind.model_fields.items())
        advice = suggested(closest(name, names), f"it has {', '.join(names) or 'none'}")
        return RequestError(f"{whose} has no {noun} {name}; {advice}.")

    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, RequestError):
        return cause

    title = ".".join([*tables, name])
    if not tables and name in kind.model_fields:
        # The name that users know the field by.
        title = kind.model_fields[name].title or title
    if first["type"] == "missing":
        return RequestError(f"the {noun} {title} of {whose} is missing: give it a value.")

    # Of a value of several types, there is an error for each type.
    of_types = [each for each in details if _location(each, values) == location]
    message = _joined([_plain_message(each) for each in of_types])

    if first["type"] == "model_type":
        message = f"it is a table: write [{title}] and its keys below it"
    if title:
        message = f"{title} of {whose} can't be {first['input']!r}: {message}"

    return RequestError(f"{message}.")


def _location(detail: ErrorDetails, values: Mapping[str, object]) -> list[str]:
    """Returns the keys and indices that lead to an invalid value.

    The location of an error also has names of types, such as `constrained-float`, where a value may
    be of several types; these are no keys of what was given.
    """
    *_, last = detail["loc"] or ("",)
    location = list[str]()
    here: Any = values
    for part in detail["loc"]:
        if _has(here, part):
            here = here[part]
        elif not location or isinstance(part, int):
            here = None
        else:
            continue
        location.append(str(part))

    if detail["type"] == "missing" and location[-1:] != [str(last)]:
        location.append(str(last))
    return location


def _has(value: Any, part: int | str) -> bool:
    """Returns whether a value has a key, or an index."""
    if isinstance(value, Mapping):
        return part in value
    return isinstance(value, list | tuple) and isinstance(part, int) and part < len(value)


def _plain_message(detail: ErrorDetails) -> str:
    """Returns the message of an error in the words of settings."""
    message = detail["msg"].rstrip(".")
    for words, plain in _PLAIN.items():
        message = message.replace(words, plain)

    if detail["type"] == "int_type" and isinstance(detail["input"], str):
        message += " such as 10000"
    return message


def _joined(messages: Sequence[str]) -> str:
    """Returns messages as one: it should be a valid number, or 'auto'."""
    first, *others = dict.fromkeys(messages)
    should = "it should be "
    if all(message.startswith(should) for message in (first, *others)):
        others = [message.removeprefix(should) for message in others]
    return ", or ".join([first, *others])
