"""The manifest of a record: settings, status, provenance and list of files."""

import re
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
)

from jbench.errors import WorkError
from jbench.settings.base import canonical_json

SCHEMA_VERSION = 5
"""Version of manifests and tables; incremented when either changes its meaning.

A record keeps the version with which it was created; `older.py` upgrades rows of older ones.
"""

OLDEST_SCHEMA_VERSION = 1
"""The oldest readable version."""

MANIFEST = "manifest.json"

FORMULA = ("=", "+", "@")
"""Spreadsheets evaluate texts that begin with these; see `is_formula`."""

Kind = Literal["dataset", "encoder", "run", "evaluation", "import"]
Status = Literal["unfinished", "finished", "failed"]

KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds in order of dependence: later ones are made from earlier ones."""

_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")

# Settings, tables and dates are written to CSV, SVG, LaTeX, Markdown and terminals. Third parties
# may name algorithms and engines within these limits: "cleanrl-td3", "sb3_contrib:TQC".
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:+/-]*")
_TEXT = re.compile(r"(?:[A-Za-z0-9._(\[][A-Za-z0-9 _.,:;+*/()\[\]=^%~-]*)?")
_NAMES = frozenset(
    {
        *("task", "algo", "representation", "encoder", "dataset", "kind", "policy", "robot"),
        *("engine", "time_limit", "precision"),
    }
)
_MAX_INTEGER = 2**63  # exclusive bound of a 64-bit column


def _plain_name(name: str) -> str:
    """Checks that a listed file is in its record's directory."""
    if not _FILE_NAME.fullmatch(name) or name == MANIFEST:
        raise ValueError("a file is named outside its own directory")
    return name


def _plain_table(name: str | None) -> str | None:
    if name is not None and not _FILE_NAME.fullmatch(name):
        raise ValueError(f"{name[:40]!r} can't be the name of a table or a checkpoint")
    return name


def _plain_date(text: str) -> str:
    if not re.fullmatch(r"[0-9A-Za-z:.+ -]{0,64}", text):
        raise ValueError(f"{text[:40]!r} can't be a date")
    return text


def plain_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Returns the settings after checking their numbers and the characters of their texts.

    Raises:
        ValueError: if a text or a number can't be recorded.
    """
    canonical_json(settings)  # refuses NaN and infinite numbers, of which no hash can be made
    for name in _NAMES & settings.keys():
        value = settings[name]
        if isinstance(value, str) and not _NAME.fullmatch(value):
            raise ValueError(f"{value[:40]!r} can't be the setting {name}")
    for text in _texts(settings):
        if not _TEXT.fullmatch(text):
            raise ValueError(f"{text[:40]!r} can't be in settings")
    return settings


def is_formula(text: str) -> bool:
    """Returns whether a spreadsheet might evaluate a text; an option of a command is none."""
    return text[:1] in FORMULA or (text[:1] == "-" and ("|" in text or "(" in text))


def _plain_provenance(provenance: dict[str, Any]) -> dict[str, Any]:
    """Checks the texts of provenance; a command may contain any printable text."""
    texts = _texts(provenance)
    typed = set(_texts({"command": provenance.get("command")}))
    for text in texts:
        if not text.isprintable() or is_formula(text) or ("<" in text and text not in typed):
            raise ValueError(f"{text[:40]!r} can't be in provenance")
    return provenance


def _plain_summary(summary: dict[str, Any]) -> dict[str, Any]:
    """Checks numbers only: the text of an error is free, and no table contains it."""
    _texts(summary)
    return summary


def _texts(value: Any) -> list[str]:
    """Returns all texts in a JSON value, including keys.

    Raises:
        ValueError: if an integer is too large for a column.
    """
    texts: list[str] = []
    stack = [value]
    while stack:
        item = stack.pop()
        kind = type(item)
        if kind is str:
            texts.append(item)
        elif kind is dict:
            texts += item
            stack += item.values()
        elif kind is list or kind is tuple:
            stack += item
        elif kind is int and not -_MAX_INTEGER <= item < _MAX_INTEGER:
            raise ValueError("a number is too large")
    return texts


def reason_of(error: ValidationError) -> str:
    """Returns the first reason for which a manifest is invalid, as a clause."""
    return error.errors()[0]["msg"].removeprefix("Value error, ")


class VersionError(WorkError):
    """The manifest has a schema version that this jbench can't read."""


class FileEntry(BaseModel):
    """One committed file of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, AfterValidator(_plain_name)]
    table: Annotated[str | None, AfterValidator(_plain_table)] = Field(
        default=None, description="table that its rows belong to"
    )
    role: Annotated[str | None, AfterValidator(_plain_table)] = Field(
        default=None,
        exclude_if=lambda role: role is None,
        description="name of a checkpoint; a newer file of the same role replaces it",
    )
    rows: int = Field(default=0, ge=0)
    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class _Versioned(BaseModel):
    """The field that every version of a manifest has."""

    schema_version: int


class Manifest(BaseModel):
    """The state of a record at its last commit."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    kind: Kind
    id: str
    status: Status = "unfinished"
    settings: Annotated[dict[str, Any], AfterValidator(plain_settings)] = Field(
        description="what produced it; hashed into its id"
    )
    summary: Annotated[dict[str, Any], AfterValidator(_plain_summary)] = Field(
        default_factory=dict, description="short results"
    )
    provenance: Annotated[dict[str, Any], AfterValidator(_plain_provenance)] = Field(
        default_factory=dict, description="versions, machine and command"
    )
    created: Annotated[str, AfterValidator(_plain_date)] = Field(description="UTC, ISO 8601")
    updated: Annotated[str, AfterValidator(_plain_date)] = Field(description="UTC, ISO 8601")
    files: tuple[FileEntry, ...] = ()

    @field_validator("files")
    @classmethod
    def _listed_once(cls, files: tuple[FileEntry, ...]) -> tuple[FileEntry, ...]:
        if len({entry.name for entry in files}) < len(files):
            raise ValueError("a file is listed twice")
        return files

    def to_bytes(self) -> bytes:
        """Returns the manifest as indented JSON."""
        return (self.model_dump_json(indent=1) + "\n").encode()

    @classmethod
    def from_bytes(cls, content: bytes, where: str) -> "Manifest":
        """Reads a manifest, which error messages call `where`.

        Raises:
            VersionError: if this jbench can't read its schema version.
            WorkError: if it is damaged.
        """
        try:
            # The version is read first, since newer manifests may have other fields.
            version = _Versioned.model_validate_json(content).schema_version
            if version > SCHEMA_VERSION:
                raise VersionError(
                    f"{where} is of schema version {version}, and this jbench reads up to "
                    f"{SCHEMA_VERSION}; install a newer jbench."
                )
            if version < OLDEST_SCHEMA_VERSION:
                raise VersionError(
                    f"{where} is of schema version {version}, and this jbench reads from "
                    f"{OLDEST_SCHEMA_VERSION}: read it with the jbench that wrote it, or delete it "
                    "and make it again."
                )
            return cls.model_validate_json(content)
        except ValidationError as error:
            raise WorkError(
                f"{where} is not a manifest that can be read ({reason_of(error)})."
            ) from None
