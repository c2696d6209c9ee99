"""How tables are written down: columns of one type and unit, and the schema that they make."""

from functools import partial
from itertools import chain

import pyarrow as pa

Columns = list[pa.Field]


def columns(type_: pa.DataType, *names: str, unit: str | None = None) -> Columns:
    """Returns columns of one type and unit."""
    metadata = {"unit": unit} if unit else None
    return [pa.field(name, type_, metadata=metadata) for name in names]


def table(*groups: Columns) -> pa.Schema:
    """Returns the schema of a table with these columns."""
    return pa.schema(chain.from_iterable(groups))


text = partial(columns, pa.string())
int16 = partial(columns, pa.int16())
int32 = partial(columns, pa.int32())
int64 = partial(columns, pa.int64())
float32 = partial(columns, pa.float32())
float64 = partial(columns, pa.float64())
