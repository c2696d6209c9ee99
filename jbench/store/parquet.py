"""Rows as the bytes of a Parquet file, and back."""

import io
from collections.abc import Sequence

import pyarrow as pa
import pyarrow.parquet as pq

_MOST_CELLS = 200_000_000  # in one file: a few bytes can claim rows that fill all memory


def to_bytes(rows: pa.Table) -> bytes:
    """Returns the Parquet file of some rows."""
    # Measured floats have hardly a value twice: a dictionary of them is wasted, and their bytes
    # compress by a third better when split by place.
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


def from_bytes(content: bytes, rows: int, dictionaries: Sequence[str] = ()) -> pa.Table:
    """Returns the rows of a Parquet file, with whatever columns it has.

    Args:
        content: of the file.
        rows: how many there should be.
        dictionaries: columns to read as dictionaries: texts that stand in many rows.

    Raises:
        ValueError: if it is no Parquet file, or one of other rows.
    """
    try:
        # pyarrow 26 aborts processes that end soon after it has started threads of its own; of its
        # ways to read, only this one starts none.
        file = pq.ParquetFile(
            pa.BufferReader(content), pre_buffer=False, read_dictionary=dictionaries
        )
        found = file.metadata.num_rows
        if found != rows:
            raise ValueError(f"{found} rows, not {rows}")
        if found * file.metadata.num_columns > _MOST_CELLS:
            raise ValueError(f"{found} rows are more than a file has")
        return file.read(use_threads=False)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(str(error).splitlines()[0]) from None
