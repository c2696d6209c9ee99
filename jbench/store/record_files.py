"""The files that a manifest lists: writing, reading and checking them, and tables as Parquet."""

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.store import files
from jbench.store.manifest import FileEntry

if TYPE_CHECKING:
    import pandas as pd

_RENAMED = {"encoder_epochs": {"train_mse": "train_loss"}}
"""Columns with another name in version 1, by table."""


def write(directory: Path, name: str, content: bytes, **about: Any) -> FileEntry:
    """Writes a file; returns its entry for the manifest, with what else is known about it.

    A name is made unique by the hash of the content in place of `*`.
    """
    sha256 = files.sha256(content)
    name = name.replace("*", sha256[:8])
    files.write_atomic(directory / name, content)
    return FileEntry(name=name, bytes=len(content), sha256=sha256, **about)


def write_checkpoints(directory: Path, checkpoints: Mapping[str, bytes]) -> list[FileEntry]:
    """Writes the content of each role to a file of its own; returns their entries."""
    return [
        write(directory, f"{Path(role).stem}-*{Path(role).suffix}", content, role=role)
        for role, content in checkpoints.items()
    ]


def write_rows(directory: Path, table: str, rows: pa.Table, number: int) -> FileEntry:
    """Writes rows of a table to a file, whose number shows the order of the table's files."""
    name = f"{table}-{number:05d}-*.parquet"
    return write(directory, name, to_bytes(rows), table=table, rows=rows.num_rows)


def read(directory: Path, entry: FileEntry, advice: str = "") -> bytes:
    """Returns the content of a file; `advice` is a clause for one that is damaged.

    Raises a DamagedError if it is missing or not what the manifest lists, and an UnreadableError if
    reading it fails, perhaps temporarily.
    """
    with _opened(directory, entry, advice) as file:
        content = file.read()
        _check_digest(files.sha256(content), entry)
        return content


def read_rows(
    directory: Path, entry: FileEntry, advice: str, columns: pa.Schema | None, is_old: bool
) -> pa.Table:
    """Returns columns, or all, of a file; see `read`. Columns that an old one lacks are null."""
    with _opened(directory, entry, advice) as file:
        content = file.read()
        _check_digest(files.sha256(content), entry)
        source = pa.BufferReader(content)
        footer = pq.read_metadata(source)
        wanted = () if columns is None else columns
        _check_footer(footer, entry, () if is_old else [field.name for field in wanted])
        names = footer.schema.names
        coded = [
            field.name
            for field in wanted
            if field.name in names and pa.types.is_dictionary(field.type)
        ]
        # pyarrow 26 aborts processes that exit soon after it has started threads; only this way of
        # reading starts none.
        table = pq.ParquetFile(source, metadata=footer, read_dictionary=coded, pre_buffer=False)
        selected = None if columns is None or is_old else columns.names
        rows = table.read(selected, use_threads=False)
        if columns is not None and is_old:
            rows = _with_columns(rows, entry.table or "", columns)
        if columns is None or rows.schema.equals(columns, check_metadata=True):
            return rows  # a cast takes a sixth of the time of reading
        return rows.select(columns.names).cast(columns)


def _with_columns(rows: pa.Table, table: str, columns: pa.Schema) -> pa.Table:
    """Returns rows of an older version with the present columns; those that they lack are null."""
    new_names = _RENAMED.get(table, {})
    rows = rows.rename_columns([new_names.get(name, name) for name in rows.column_names])
    for field in columns:
        if field.name not in rows.column_names:
            rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    return rows


def check(directory: Path, entry: FileEntry, columns: Sequence[str]) -> None:
    """Checks a file in chunks, and that it has the columns; raises the errors of `read`."""
    with _opened(directory, entry) as file:
        _check_digest(hashlib.file_digest(file, "sha256").hexdigest(), entry)
        if entry.table is not None:
            _check_footer(pq.read_metadata(file), entry, columns)


def _check_digest(sha256: str, entry: FileEntry) -> None:
    """Raises a ValueError if a content is not the one that the manifest lists."""
    if sha256 != entry.sha256:
        raise ValueError("its checksum differs")


def _check_footer(footer: pq.FileMetaData, entry: FileEntry, columns: Sequence[str]) -> None:
    """Raises a ValueError if a Parquet file lacks rows or columns."""
    if footer.num_rows != entry.rows:
        raise ValueError(f"{footer.num_rows} rows, not {entry.rows}")
    for name in columns:
        if name not in footer.schema.names:
            raise ValueError(f"it has no column {name}: another version of jbench wrote it")


@contextlib.contextmanager
def _opened(directory: Path, entry: FileEntry, advice: str = "") -> Iterator[io.BufferedReader]:
    """Opens a file of the listed size; errors in the block are those of `read`."""
    path = directory / entry.name
    try:
        with files.open_plain(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size != entry.bytes:
                raise ValueError(f"{size} bytes, not {entry.bytes}")
            yield file
    except (ValueError, OSError, pa.ArrowException) as error:
        reason = str(getattr(error, "strerror", None) or error).splitlines()[0]
        # pyarrow's errors have no number.
        if isinstance(error, OSError) and error.errno and not files.is_missing(error):
            raise files.UnreadableError(path, f"can't be read ({reason})") from None
        raise files.DamagedError(path, f"is damaged ({reason})", advice) from None


def to_table(frame: "pd.DataFrame", columns: pa.Schema) -> pa.Table:
    """Returns the rows of a frame as a table with these columns; those that it lacks are null."""
    arrays = []
    for field in columns:
        if field.name in frame:
            arrays.append(pa.array(frame[field.name], field.type, from_pandas=True))
        else:
            arrays.append(pa.nulls(len(frame), field.type))

    return pa.table(arrays, schema=columns)


def to_bytes(rows: pa.Table) -> bytes:
    """Returns the Parquet file of some rows."""
    # Measured floats rarely repeat, so dictionaries do not help; byte stream split compresses them
    # by a third better.
    floats = [field.name for field in rows.schema if pa.types.is_floating(field.type)]
    sink = io.BytesIO()
    pq.write_table(
        rows,
        sink,
        compression="zstd",
        use_dictionary=[name for name in rows.column_names if name not in floats],
        use_byte_stream_split=floats,
    )
    return sink.getvalue()
