"""SQL over the results: DuckDB as a lens over the committed rows, owning no data."""

import csv
import io
import json
import re
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from typing import Any, NamedTuple

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.errors import RequestError, WorkError
from jbench.names import FULL
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.provenance import cores
from jbench.store.record import Record
from jbench.store.rows import KINDS, Row, row_of


class Tables(NamedTuple):
    """Tables of a results directory, and a sentence for each record that can't be read."""

    tables: dict[str, pa.Table]
    problems: list[str]


class Answer(NamedTuple):
    """The answer to a query, and a sentence for each record that is not in it, being damaged."""

    rows: pd.DataFrame
    problems: list[str]


def load(
    results: Results,
    names: Collection[str] = tuple(schema.TABLES),
    *,
    coded: bool = False,
    columns: Mapping[str, Sequence[str]] | None = None,
) -> Tables:
    """Reads and checks tables of a results directory; a damaged record is left out whole.

    Args:
        results: to read from.
        names: of the tables. Files of others are not read, nor checked.
        coded: whether the ids in rows of files come as Arrow dictionaries, which need a tenth of
            the memory.
        columns: of tables of files, to keep; of tables that are not named here, all.
    """
    kept = columns or {}
    tables: dict[str, pa.Table] = {}
    problems: list[str] = []
    if "published" in names:
        tables["published"] = published()
    for kind, (table, _, of_files) in KINDS.items():
        wanted = {name: _coded(c) if coded else c for name, c in of_files.items() if name in names}
        if not wanted and table not in names:
            continue
        records, unreadable = results.scan(kind)
        read, damaged = _read(records, wanted, kept)
        problems += unreadable + damaged
        for name, whole in wanted.items():
            empty = whole.empty_table().select(kept.get(name, whole.names))
            tables[name] = pa.concat_tables([empty, *(parts[name] for _, parts in read)])
        if table in names:
            rows = [row for row, _ in read]
            tables[table] = pa.Table.from_pylist(rows, schema.TABLES[table])
    return Tables(tables, problems)


def published() -> pa.Table:
    """Returns the paper's learning curves, its full-16 and dae-12 under our names `full`, `dae12`.

    The curve of SAC on a sequence of robots keeps a name of its own. The medians of fig8 come
    twice, with two pairs of bands (fig8 and fig8-10-90): choose by `figure`.
    """
    source = resources.files("jbench.paper").joinpath("published_curves.csv").read_bytes()
    rows = pd.read_csv(io.BytesIO(source))
    names = rows["representation"].str.replace(r"^full-\d+", FULL, regex=True)
    rows["representation"] = names.str.replace("dae-", "dae", regex=False)
    return pa.Table.from_pandas(rows, schema.PUBLISHED, preserve_index=False, nthreads=1)


def ask(results: Results, sql: str) -> Answer:
    """Returns the answer of one SELECT over the results.

    Raises:
        RequestError: as `run_sql`.
    """
    # Arrow's own allocator gives memory back and takes it again, file by file: a third of the time.
    pa.set_memory_pool(pa.system_memory_pool())
    # Tables are read that stand in the SQL. One may be called by a name made up within it: DuckDB
    # then says that there is none, and all are read.
    words = set(re.findall(r"\w+", sql.lower()))
    named = words & set(schema.TABLES) or set(schema.TABLES)
    loaded = load(results, named, coded=True)
    try:
        return Answer(_select(sql, loaded.tables), loaded.problems)
    except duckdb.CatalogException:
        loaded = load(results, coded=True)
        return Answer(run_sql(sql, loaded.tables), loaded.problems)
    except duckdb.Error as error:
        raise _refusal(error, schema.TABLES) from None


def run_sql(sql: str, tables: Mapping[str, pa.Table]) -> pd.DataFrame:
    """Returns the answer of one SELECT over the tables, without access to anything else.

    Raises:
        RequestError: if it is not one SELECT, or DuckDB refuses it.
    """
    try:
        return _select(sql, tables)
    except duckdb.Error as error:
        raise _refusal(error, tables) from None


def _select(sql: str, tables: Mapping[str, pa.Table]) -> pd.DataFrame:
    """Returns the answer of one SELECT; Ctrl-C ends it.

    DuckDB notices Ctrl-C only at some places, and turns it into errors of its own. So it works on
    another thread, and Ctrl-C reaches this one.
    """
    connection = duckdb.connect(":memory:", config={"python_enable_replacements": False})
    try:
        with ThreadPoolExecutor(1) as thread:
            answer = thread.submit(_answer, connection, sql, tables)
            try:
                return answer.result()
            except KeyboardInterrupt:
                while not answer.done():  # an interrupt before the query starts has no effect
                    connection.interrupt()
                    time.sleep(0.01)
                raise
    finally:
        connection.close()


def _answer(
    connection: duckdb.DuckDBPyConnection, sql: str, tables: Mapping[str, pa.Table]
) -> pd.DataFrame:
    for name, rows in tables.items():
        connection.register(name, rows)
    # What does not fit into the memory would go into files in the working directory.
    connection.execute("SET temp_directory = ''")
    # From here on no file, no network and no extension, and no way to turn them on again.
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")
    statements = connection.extract_statements(sql)
    if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
        raise RequestError("A query is one SELECT statement; the results are read-only.")
    return connection.execute(statements[0]).df()


def _refusal(error: duckdb.Error, tables: Iterable[str]) -> RequestError:
    message = str(error).splitlines()[0]
    return RequestError(f"{message} (tables: {', '.join(sorted(tables))}).")


def to_csv(frame: pd.DataFrame) -> str:
    """Returns the rows as CSV with a header."""
    return frame.to_csv(index=False, lineterminator="\n", quoting=csv.QUOTE_MINIMAL)


def to_json(frame: pd.DataFrame) -> str:
    """Returns the rows as a JSON list of objects; what is missing or infinite is null."""
    said = frame.notna() & ~frame.isin([np.inf, -np.inf])
    rows = frame.astype(object).where(said, None).to_dict("records")
    return json.dumps(rows, indent=1, default=_plain, allow_nan=False)


def _plain(value: Any) -> Any:
    """Returns what JSON has for a value of another type: a number, or the value's text."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)


def _read(
    records: Sequence[Record],
    schemas: Mapping[str, pa.Schema],
    kept: Mapping[str, Sequence[str]],
) -> tuple[list[tuple[Row, dict[str, pa.Table]]], list[str]]:
    """Returns the row and the parts of each record, and a sentence for each damaged one."""

    def read(record: Record) -> tuple[Row, dict[str, pa.Table]] | str:
        while True:
            try:
                parts = {
                    name: record.read(name, columns).select(kept.get(name, columns.names))
                    for name, columns in schemas.items()
                }
                return row_of(record), parts
            except WorkError as error:
                if not record.refresh():
                    return str(error)

    # pyarrow and hashlib let go of the interpreter while they work.
    with ThreadPoolExecutor(cores()) as threads:
        outcomes = list(threads.map(read, records))
    return (
        [outcome for outcome in outcomes if not isinstance(outcome, str)],
        [outcome for outcome in outcomes if isinstance(outcome, str)],
    )


def _coded(columns: pa.Schema) -> pa.Schema:
    """Returns the columns of a table of files with its record's id, the first, as a dictionary."""
    key = columns.field(0)
    return columns.set(0, key.with_type(pa.dictionary(pa.int32(), key.type)))
