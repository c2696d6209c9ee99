"""The files that a manifest lists: writing, reading and checking them."""

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.store import files, parquet
from jbench.store.flaws import DamagedError, UnreadableError
from jbench.store.manifest import FileEntry

_OTHER_SUM = "its checksum differs"

_RENAMED = {"encoder_epochs": {"train_mse": "train_loss"}}
"""Columns with another name in version 1, by table.

Not every kind of encoder minimizes a squared error. Columns that later versions added are null.
"""


def write(
    directory: Path,
    name: str,
    content: bytes,
    table: str | None = None,
    rows: int = 0,
    role: str | None = None,
) -> FileEntry:
    """Writes a file atomically; returns its entry for the manifest, with these values."""
    files.write_atomic(directory / name, content)
    size, digest = len(content), files.sha256(content)
    return FileEntry(name=name, table=table, role=role, rows=rows, bytes=size, sha256=digest)


def write_rows(directory: Path, table: str, number: int, rows: pa.Table) -> FileEntry:
    """Writes rows of a table; the number shows the order of its files."""
    content = parquet.to_bytes(rows)
    # The hash makes the name unique.
    name = f"{table}-{number:05d}-{files.sha256(content)[:8]}.parquet"
    return write(directory, name, content, table, rows.num_rows)


def write_checkpoint(directory: Path, role: str, content: bytes) -> FileEntry:
    """Writes the checkpoint of a role; the previous one stays intact until the commit."""
    name = f"{Path(role).stem}-{files.sha256(content)[:8]}{Path(role).suffix}"
    return write(directory, name, content, role=role)


def read(directory: Path, entry: FileEntry, advice: str = "") -> bytes:
    """Returns the content of a file.

    Args:
        advice: what to do if it is damaged, as a clause.

    Raises:
        DamagedError: if it is missing or not what the manifest lists.
        UnreadableError: if reading it fails, perhaps temporarily.
    """
    with _opened(directory, entry, advice) as file:
        content = file.read()
    if files.sha256(content) != entry.sha256:
        raise _damaged(directory, entry, _OTHER_SUM, advice)
    return content


def read_rows(
    directory: Path, entry: FileEntry, advice: str, columns: pa.Schema | None, is_old: bool
) -> pa.Table:
    """Returns the rows of a file; see `read`.

    Args:
        columns: to return; None for those that it has.
        is_old: whether it was written with an older schema version.
    """
    content = read(directory, entry, advice)
    source = pa.BufferReader(content)
    try:
        metadata = pq.read_metadata(source)
        names = metadata.schema.names
        if metadata.num_rows != entry.rows:
            raise ValueError(f"{metadata.num_rows} rows, not {entry.rows}")
        wanted = () if columns is None else columns
        missing = [field.name for field in wanted if field.name not in names]
        if missing and not is_old:
            raise ValueError(f"it has no column {missing[0]}: another version of jbench wrote it")
        coded = [f.name for f in wanted if f.name in names and pa.types.is_dictionary(f.type)]
        # pyarrow 26 aborts processes that exit soon after it has started threads; only this way of
        # reading starts none.
        file = pq.ParquetFile(source, metadata=metadata, read_dictionary=coded, pre_buffer=False)
        selected = None if columns is None or is_old else columns.names
        rows = file.read(selected, use_threads=False)
        if columns is None:
            return rows
        if is_old:
            rows = _upgrade(entry.table or "", rows, columns)
        if rows.schema.equals(columns, check_metadata=True):
            return rows  # a cast takes a sixth of the time of reading
        return rows.select(columns.names).cast(columns)
    except (ValueError, OSError, pa.ArrowException) as error:
        raise _damaged(directory, entry, str(error).splitlines()[0], advice) from None


def _upgrade(table: str, rows: pa.Table, columns: pa.Schema) -> pa.Table:
    """Returns rows of an older version with the current columns; missing values are null."""
    new_names = _RENAMED.get(table, {})
    rows = rows.rename_columns([new_names.get(name, name) for name in rows.column_names])
    for field in columns:
        if field.name not in rows.column_names:
            rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    return rows


def check(directory: Path, entry: FileEntry, columns: Sequence[str]) -> None:
    """Checks a file in chunks, and that it has the columns; raises the errors of `read`."""
    with _opened(directory, entry) as file:
        if hashlib.file_digest(file, "sha256").hexdigest() != entry.sha256:
            raise _damaged(directory, entry, _OTHER_SUM)
        if entry.table is None:
            return
        try:
            footer = pq.read_metadata(file)
            names = footer.schema.to_arrow_schema().names
        except pa.ArrowException as error:
            raise _damaged(directory, entry, str(error).splitlines()[0]) from None
    if footer.num_rows != entry.rows:
        raise _damaged(directory, entry, f"{footer.num_rows} rows, not {entry.rows}")
    for name in columns:
        if name not in names:
            raise _damaged(directory, entry, f"it has no column {name}")


@contextlib.contextmanager
def _opened(directory: Path, entry: FileEntry, advice: str = "") -> Iterator[io.BufferedReader]:
    """Opens a file of the listed size."""
    path = directory / entry.name
    try:
        with files.open_plain(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size != entry.bytes:
                raise _damaged(directory, entry, f"{size} bytes, not {entry.bytes}", advice)
            yield file
    except OSError as error:
        reason = str(error.strerror or error).splitlines()[0]
        if files.is_missing(error) or error.errno is None:  # pyarrow found it to be damaged
            raise _damaged(directory, entry, reason, advice) from None
        raise UnreadableError(path, f"can't be read ({reason})") from None


def _damaged(directory: Path, entry: FileEntry, reason: str, advice: str = "") -> DamagedError:
    return DamagedError(directory / entry.name, f"is damaged ({reason})", advice)
