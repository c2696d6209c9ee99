"""Checks of a record's parts; a problem is a clause to follow the part's path."""

import hashlib
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.errors import WorkError
from jbench.settings.base import settings_hash
from jbench.store import files, schema
from jbench.store.manifest import SCHEMA_VERSION, FileEntry
from jbench.store.record import Record
from jbench.store.rows import row_of


def of_settings(record: Record) -> str | None:
    """Returns a problem if a record's settings are invalid or do not match its id."""
    try:
        row_of(record)
    except WorkError as error:
        return f"is invalid: {str(error).removesuffix('.')}"
    expected = settings_hash(record.settings)
    if record.id.endswith(f"-{expected}"):
        return None
    return f"has settings of the hash {expected}, not those that its id was made of"


def of_file(record: Record, entry: FileEntry) -> str | None:
    """Returns a problem of a file of a record, or None.

    Raises:
        OSError: if the file can't be read.
    """
    path = record.path / entry.name
    problem = _of_bytes(entry, path)
    if problem is None and entry.table is not None:
        problem = _of_rows(record, entry, path)
    return problem


def _of_bytes(entry: FileEntry, path: Path) -> str | None:
    with files.open_plain(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size != entry.bytes:
            return f"{size} bytes, not {entry.bytes}"
        if hashlib.file_digest(file, "sha256").hexdigest() != entry.sha256:
            return "its checksum differs"
    return None


def _of_rows(record: Record, entry: FileEntry, path: Path) -> str | None:
    try:
        with files.open_plain(path) as file:
            footer = pq.read_metadata(file)
        names = set(footer.schema.to_arrow_schema().names)
    except pa.ArrowException as error:
        return str(error).splitlines()[0]
    if footer.num_rows != entry.rows:
        return f"{footer.num_rows} rows, not {entry.rows}"
    columns = schema.FILES.get(entry.table or "", ())
    missing = [field.name for field in columns if field.name not in names]
    if missing and record.manifest.schema_version == SCHEMA_VERSION:
        return f"it has no column {missing[0]}"
    return None


def of_date(text: str) -> str | None:
    """Returns a problem of a date of a manifest, or None."""
    try:
        date = datetime.fromisoformat(text)
        # Clocks of different machines differ a little.
        if date > datetime.now(UTC) + timedelta(hours=1):
            return "in the future, so that its clock or this one is wrong"
    except (ValueError, TypeError):
        return "no date with a time zone"
    return None
