"""Tables of rows, and their conversion to and from the bytes of a Parquet file."""

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:
    import pandas as pd

_RENAMED = {"encoder_epochs": {"train_mse": "train_loss"}}
"""Columns with another name in version 1, by table.

Not every kind of encoder minimizes a squared error. Columns that later versions added are null.
"""


def to_table(frame: "pd.DataFrame", columns: pa.Schema) -> pa.Table:
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


def from_bytes(content: bytes, rows: int, columns: Sequence[pa.Field] | None = None) -> pa.Table:
    """Returns columns of a Parquet file in the order of the file.

    Args:
        rows: expected number of rows.
        columns: to read, of those that it has; texts of a dictionary type are read as one. None:
            all columns.

    Raises:
        ValueError: if it is not a Parquet file, or has another number of rows.
    """
    coded = [field.name for field in columns or () if pa.types.is_dictionary(field.type)]
    try:
        # pyarrow 26 aborts processes that exit soon after it has started threads; only this way of
        # reading starts none.
        file = pq.ParquetFile(pa.BufferReader(content), pre_buffer=False, read_dictionary=coded)
        if file.metadata.num_rows != rows:
            raise ValueError(f"{file.metadata.num_rows} rows, not {rows}")
        names = None if columns is None else [field.name for field in columns]
        return file.read(names, use_threads=False)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(str(error).splitlines()[0]) from None


def upgrade(table: str, rows: pa.Table, columns: pa.Schema) -> pa.Table:
    """Returns rows of an older version with the current columns; missing values are null."""
    new_names = _RENAMED.get(table, {})
    rows = rows.rename_columns([new_names.get(name, name) for name in rows.column_names])
    for field in columns:
        if field.name not in rows.column_names:
            rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    return rows
