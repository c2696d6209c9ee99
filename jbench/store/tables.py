"""The tables of a results directory, from its manifests and files."""

import io
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib import resources
from typing import NamedTuple

import pandas as pd
import pyarrow as pa

from jbench.cores import cores
from jbench.errors import WorkError
from jbench.representation_names import FULL
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.encoder_tables import KEPT
from jbench.store.kept_features import with_kept
from jbench.store.listing import final_returns
from jbench.store.record import Record
from jbench.store.rows import KIND_TABLES, Row, make_row


@dataclass(frozen=True)
class _RecordRows:
    """What a record has in the tables: its row, and the rows of its files by table."""

    row: Row
    of_files: dict[str, pa.Table]


class Tables(NamedTuple):
    """Tables of a results directory, and an error for each damaged record, which is left out."""

    tables: dict[str, pa.Table]
    problems: list[str]


def read_tables(
    results: Results,
    names: Collection[str] = tuple(schema.TABLES),
    *,
    coded: bool = False,
    columns: Mapping[str, Sequence[str]] | None = None,
    of_runs: Mapping[str, Collection[str]] | None = None,
) -> Tables:
    """Reads and checks tables of a results directory; files of other tables are not read.

    Args:
        results: which are read.
        names: of the tables.
        coded: whether ids are Arrow dictionaries, which need a tenth of the memory.
        columns: some by table; by default all.
        of_runs: the values that settings of runs may have, by name. Other runs are not read, unless
            none has such values.
    """
    selected = columns or {}
    tables: dict[str, pa.Table] = {}
    problems: list[str] = []
    if "published" in names:
        tables["published"] = published_rows()

    for kind, (table, file_tables) in KIND_TABLES.items():
        schemas = {
            name: _selected_columns(name, selected.get(name), coded)
            for name in file_tables
            if name in names
        }
        if not schemas and table not in names:
            continue
        records, unreadable = results.scan(kind)
        if kind == "run":
            records = _with_settings(records, of_runs or {}) or records
        # pyarrow and hashlib release the GIL.
        with ThreadPoolExecutor(cores()) as threads:
            outcomes = list(threads.map(partial(_read, schemas), records))
        problems += unreadable + [outcome for outcome in outcomes if isinstance(outcome, str)]
        read = [outcome for outcome in outcomes if isinstance(outcome, _RecordRows)]
        for name, fields in schemas.items():
            parts = (record.of_files[name] for record in read)
            tables[name] = pa.concat_tables([fields.empty_table(), *parts])
        if table in names:
            rows = [record.row for record in read]
            tables[table] = pa.Table.from_pylist(rows, schema.TABLES[table])

    if "final_returns" in names:
        tables["final_returns"], unread = final_returns(results)
        problems += [problem for problem in unread if problem not in problems]

    return Tables(tables, problems)


def _with_settings(
    records: Sequence[Record], allowed: Mapping[str, Collection[str]]
) -> list[Record]:
    """Returns the records whose settings have allowed values."""
    return [
        record
        for record in records
        if all(record.settings.get(name) in values for name, values in allowed.items())
    ]


def published_rows() -> pa.Table:
    """Returns the paper's learning curves; its full-16 and dae-12 are named `full` and `dae12`.

    The curve of SAC on a sequence of robots has a separate name. The medians of fig8 occur twice,
    with two pairs of bands (fig8 and fig8-10-90): select one by `figure`.
    """
    source = resources.files("jbench.paper").joinpath("published_curves.csv").read_bytes()
    rows = pd.read_csv(io.BytesIO(source))
    names = rows["representation"].str.replace(r"^full-\d+", FULL, regex=True)
    rows["representation"] = names.str.replace("dae-", "dae", regex=False)
    rows = rows.rename(columns={"training_steps": "control_steps"})
    return pa.Table.from_pandas(rows, schema.TABLES["published"], preserve_index=False, nthreads=1)


def _read(fields: Mapping[str, pa.Schema], record: Record) -> _RecordRows | str:
    """Returns the rows of a record in its own table and in others, or the error of a damaged one.

    Args:
        fields: columns by the names of the other tables.
    """

    def read() -> _RecordRows:
        """Returns the rows as the manifest lists them now."""
        of_files = {name: _rows(record, name, columns) for name, columns in fields.items()}
        return _RecordRows(make_row(record), of_files)

    try:
        return record.reading(read)
    except WorkError as error:
        return str(error)


def _rows(record: Record, name: str, columns: pa.Schema) -> pa.Table:
    """Returns columns of a record's table, those included that no file has."""
    if KEPT not in columns.names:
        return record.read(name, columns)
    return with_kept(record, record.read(name)).select(columns.names).cast(columns)


def _selected_columns(table: str, names: Sequence[str] | None, coded: bool) -> pa.Schema:
    """Returns columns of a table, by default all; ids are dictionaries if `coded`."""
    columns = schema.TABLES[table]
    if coded:
        key = columns.field(0)
        columns = columns.set(0, key.with_type(pa.dictionary(pa.int32(), key.type)))
    return pa.schema([columns.field(name) for name in names or columns.names])
