"""The manifest of a record: settings, status, provenance and list of files."""

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator

from jbench.errors import RequestError
from jbench.names import REFERENCE, Status
from jbench.settings.base import canonical_json
from jbench.store import files
from jbench.store.provenance import process_provenance, utc_now

SCHEMA_VERSION = 5
"""Version of manifests and tables; incremented when either changes its meaning.

A record keeps the version with which it was created; `record_files.py` upgrades rows of older ones.
"""

OLDEST_SCHEMA_VERSION = 1

MANIFEST = "manifest.json"

# A part of an id becomes a directory: no separators and no leading dot.
ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}(?:/[A-Za-z0-9][A-Za-z0-9_.-]{0,99})*")

RecordKind = Literal["dataset", "encoder", "run", "evaluation", "import"]
Json = Mapping[str, Any]

KINDS: tuple[RecordKind, ...] = get_args(RecordKind)
"""Kinds in order of dependence: later ones are made from earlier ones."""

_MAX_BYTES = 1 << 26  # a manifest of 100,000 files has half as many
_LONGEST = 10_000  # characters of a text
_MAX_INTEGER = 2**63  # exclusive bound of a 64-bit column


def check_json(value: Any, texts: bool = True) -> Any:
    """Returns a JSON value, or raises a ValueError if an integer does not fit a column.

    Its texts must be printable and short, unless `texts` is false.
    """
    stack = [value]
    while stack:
        item = stack.pop()
        kind = type(item)
        if kind is dict:
            stack += item
            stack += item.values()
        elif kind is list or kind is tuple:
            stack += item
        elif kind is str and texts and not (item.isprintable() and len(item) <= _LONGEST):
            raise ValueError(f"{item[:40]!r} has characters that can't be printed, or too many")
        elif kind is int and not -_MAX_INTEGER <= item < _MAX_INTEGER:
            raise ValueError("a number is too large")

    return value


def check_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """Returns settings; raises a ValueError if they can't be recorded: NaN, say, has no hash."""
    canonical_json(settings)
    check_json(settings)
    return settings


# Texts are escaped where they are written, such as in a page, in LaTeX and in CSV.
_Date = Annotated[str, Field(max_length=64), AfterValidator(check_json)]
# A name begins with no dot and has no slash, so that it is in the record's own directory.
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,199}$")]


class FileEntry(BaseModel):
    """One committed file of a record."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: _Name
    table: _Name | None = Field(None, description="table that its rows belong to")
    role: _Name | None = Field(
        None,
        exclude_if=lambda role: role is None,
        description="name of a checkpoint; a newer file of the same role replaces it",
    )
    rows: int = Field(0, ge=0)
    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class Origin(NamedTuple):
    """The record that another one was made of."""

    kind: RecordKind
    id: str


class _Versioned(BaseModel):
    """The field that every version of a manifest has."""

    schema_version: int


class Manifest(BaseModel):
    """The state of a record at its last commit."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    kind: RecordKind
    id: str
    status: Status = "unfinished"
    settings: Annotated[dict[str, Any], AfterValidator(check_settings)] = Field(
        description="what produced it; hashed into its id"
    )
    # The error of a failed record may have several lines.
    summary: Annotated[dict[str, Any], AfterValidator(partial(check_json, texts=False))] = Field(
        default_factory=dict, description="short results"
    )
    provenance: Annotated[dict[str, Any], AfterValidator(check_json)] = Field(
        default_factory=dict, description="versions, machine and command"
    )
    created: _Date = Field(description="UTC, ISO 8601")
    updated: _Date = Field(description="UTC, ISO 8601")
    files: tuple[FileEntry, ...] = ()

    @field_validator("files")
    @classmethod
    def _listed_once(cls, files: tuple[FileEntry, ...]) -> tuple[FileEntry, ...]:
        """Raises a ValueError if two entries would be one file."""
        if len({MANIFEST, *(entry.name for entry in files)}) <= len(files):
            raise ValueError("a file is listed twice, or is the manifest")
        return files

    @property
    def is_old(self) -> bool:
        """Whether tables may lack columns of this schema version."""
        return self.schema_version < SCHEMA_VERSION

    @property
    def origin(self) -> Origin | None:
        """The record of the same results that this one was made of; None if there is none."""
        if self.kind == "run" and self.settings.get("encoder") is not None:
            return Origin("encoder", str(self.settings["encoder"]))
        if self.kind == "encoder" and self.settings.get("dataset") is not None:
            return Origin("dataset", str(self.settings["dataset"]))
        if self.kind == "evaluation":
            # Hand-written policies have no slash in their names, and shipped ones begin so.
            policy = str(self.settings.get("policy"))
            if "/" in policy and not policy.startswith(f"{REFERENCE}/"):
                return Origin("run", policy)
        return None

    @classmethod
    def new(cls, kind: RecordKind, id: str, settings: Json, made_on: Json) -> "Manifest":
        """Returns the manifest of a new record; raises a RequestError if it can't be recorded."""
        dates: Json = dict.fromkeys(("created", "updated"), utc_now())
        made = {**process_provenance(), **made_on}
        try:
            return cls(kind=kind, id=id, settings=dict(settings), provenance=made, **dates)
        except ValidationError as error:
            raise RequestError(f"The {kind} {id} can't be saved ({_reason(error)}).") from None

    def to_bytes(self) -> bytes:
        """Returns the manifest as indented JSON."""
        return (self.model_dump_json(indent=1) + "\n").encode()

    @classmethod
    def read(cls, path: Path) -> "Manifest | None":
        """Reads a manifest; returns None if the file does not exist.

        Raises an UnreadableError if reading it fails, perhaps temporarily, or it is of another
        version, and a DamagedError if it is no manifest.
        """
        try:
            with files.open_plain(path) as file:
                content = file.read(_MAX_BYTES + 1)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            kind = files.DamagedError if files.is_missing(error) else files.UnreadableError
            raise kind(path, f"can't be read ({error.strerror})") from None

        if len(content) > _MAX_BYTES:
            raise files.DamagedError(path, "is larger than any manifest; it is not read")

        try:
            # The version is read first, since newer manifests may have other fields.
            version = _Versioned.model_validate_json(content).schema_version
            if not OLDEST_SCHEMA_VERSION <= version <= SCHEMA_VERSION:
                readable = f"{OLDEST_SCHEMA_VERSION} to {SCHEMA_VERSION}"
                problem = f"is of schema version {version}, and this jbench reads {readable}"
                raise files.UnreadableError(path, f"{problem}; install the jbench that wrote it")

            return cls.model_validate_json(content)
        except ValidationError as error:
            problem = f"is not a manifest that can be read ({_reason(error)})"
            raise files.DamagedError(path, problem) from None


def _reason(error: ValidationError) -> str:
    """Returns the reason of the first error, without pydantic's prefix."""
    return error.errors()[0]["msg"].removeprefix("Value error, ")
