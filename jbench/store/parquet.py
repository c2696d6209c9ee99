"""Tables of rows, and their conversion to the bytes of a Parquet file."""

import io
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:
    import pandas as pd


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
