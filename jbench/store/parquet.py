"""Tables of rows, and their conversion to and from the bytes of a Parquet file."""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

if TYPE_CHECKING:
    import pandas as pd

# Limits of one file: a few bytes can decompress to more than the memory.
_MAX_CELLS = 50_000_000
_MAX_BYTES = 1 << 29


def table_of(frame: "pd.DataFrame", columns: pa.Schema) -> pa.Table:
    """Returns the rows of a frame as a table with these columns; those that it lacks are null."""
    return pa.table(
        [
            pa.array(frame[field.name], field.type, from_pandas=True)
            if field.name in frame
            else pa.nulls(len(frame), field.type)
            for field in columns
        ],
        schema=columns,
    )


def to_bytes(rows: pa.Table) -> bytes:
    """Returns the Parquet file of some rows."""
    # Measured floats rarely repeat, so dictionaries do not help; byte stream split compresses them
    # by a third better.
    floats = [f.name for f in rows.schema if pa.types.is_floating(f.type)]
    sink = io.BytesIO()
    pq.write_table(
        rows,
        sink,
        compression="zstd",
        use_dictionary=[name for name in rows.column_names if name not in floats],
        use_byte_stream_split=floats,
    )
    return sink.getvalue()


def from_bytes(
    content: bytes,
    rows: int,
    dictionaries: Sequence[str] = (),
    columns: Sequence[str] | None = None,
) -> pa.Table:
    """Returns columns of a Parquet file in the order of the file.

    Args:
        rows: expected number of rows.
        dictionaries: text columns to return as dictionaries.
        columns: to return, of those that it has; None: all.

    Raises:
        ValueError: if it is not a Parquet file, has another number of rows, or is too large.
    """
    try:
        # Texts are read as dictionaries first, so that many copies of a text take no memory until
        # their size is known.
        metadata = pq.read_metadata(pa.BufferReader(content))
        texts = _checked_texts(metadata, rows)
        if columns is not None:
            texts = [name for name in texts if name in columns]
        # pyarrow 26 aborts processes that exit soon after it has started threads; only this way of
        # reading starts none.
        file = pq.ParquetFile(
            pa.BufferReader(content),
            metadata=metadata,
            pre_buffer=False,
            read_dictionary=texts,
        )
        table = file.read(columns, use_threads=False)
        plain = [name for name in texts if name not in dictionaries]
        if sum(_size_of_texts(table[name]) for name in plain) > _MAX_BYTES:
            raise ValueError(f"its texts are larger than {_MAX_BYTES >> 20} MiB")
        for name in plain:
            index = table.column_names.index(name)
            kind = table.schema.field(index).type.value_type
            table = table.set_column(index, name, table[name].cast(kind))
        return table
    except (pa.ArrowException, OSError) as error:
        raise ValueError(str(error).splitlines()[0]) from None


def _checked_texts(metadata: pq.FileMetaData, rows: int) -> list[str]:
    """Returns the text columns of a file whose metadata are within the limits.

    Raises:
        ValueError: if they are not, or the number of rows differs.
    """
    count, columns = metadata.num_rows, metadata.schema.to_arrow_schema()
    if count != rows:
        raise ValueError(f"{count} rows, not {rows}")
    nested = [field.name for field in columns if pa.types.is_nested(field.type)]
    if nested:
        raise ValueError(f"the column {nested[0]} is nested")
    if count * len(columns) > _MAX_CELLS:
        raise ValueError(f"{count} rows are more than a file has")
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    if sum(group.num_rows for group in groups) != count:
        raise ValueError("its groups have other rows")
    unpacked = sum(
        group.column(i).total_uncompressed_size
        for group in groups
        for i in range(group.num_columns)
    )
    if unpacked > _MAX_BYTES:
        raise ValueError(f"it unpacks to {unpacked >> 20} MiB")
    return [field.name for field in columns if _is_text(field.type)]


def _is_text(kind: pa.DataType) -> bool:
    if pa.types.is_dictionary(kind):
        return _is_text(kind.value_type)
    return kind in (pa.string(), pa.large_string(), pa.binary(), pa.large_binary())


def _size_of_texts(column: pa.ChunkedArray) -> int:
    """Returns the bytes of the texts of a column without a dictionary."""
    total = 0
    for chunk in column.chunks:
        lengths = pc.binary_length(chunk.dictionary)
        total += pc.sum(lengths.cast(pa.int64()).take(chunk.indices)).as_py() or 0
    return total
