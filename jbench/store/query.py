"""SQL over the committed rows with DuckDB."""

import contextlib
import io
import re
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import resources
from typing import Any, NamedTuple

import duckdb
import pandas as pd
import pyarrow as pa

from jbench.cores import cores
from jbench.errors import RequestError, WorkError
from jbench.names import FULL, shown_representation
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.kept import with_kept
from jbench.store.listing import final_returns
from jbench.store.record import Record
from jbench.store.rows import KIND_TABLES, Row, make_row
from jbench.wording import not_formula


class Tables(NamedTuple):
    """Tables of a results directory, and an error for each damaged record, which is left out."""

    tables: dict[str, pa.Table]
    problems: list[str]


def load(
    results: Results,
    names: Collection[str] = tuple(schema.TABLES),
    *,
    coded: bool = False,
    columns: Mapping[str, Sequence[str]] | None = None,
) -> Tables:
    """Reads and checks tables of a results directory; files of other tables are not read.

    `columns` selects some by table. If `coded`, ids are Arrow dictionaries, which need a tenth of
    the memory.
    """
    selected = columns or {}
    tables: dict[str, pa.Table] = {}
    problems: list[str] = []
    if "published" in names:
        tables["published"] = published()

    for kind, (table, file_tables) in KIND_TABLES.items():
        schemas = {
            name: _selected_columns(name, selected.get(name), coded)
            for name in file_tables
            if name in names
        }
        if not schemas and table not in names:
            continue
        records, unreadable = results.scan(kind)
        # pyarrow and hashlib release the GIL.
        with ThreadPoolExecutor(cores()) as threads:
            outcomes = list(threads.map(partial(_read, schemas), records))
        problems += unreadable + [outcome for outcome in outcomes if isinstance(outcome, str)]
        read = [outcome for outcome in outcomes if not isinstance(outcome, str)]
        for name, fields in schemas.items():
            parts = (tables_read[name] for _, tables_read in read)
            tables[name] = pa.concat_tables([fields.empty_table(), *parts])
        if table in names:
            rows = [row for row, _ in read]
            tables[table] = pa.Table.from_pylist(rows, schema.TABLES[table])

    if "final_returns" in names:
        tables["final_returns"], unread = final_returns(results)
        problems += [problem for problem in unread if problem not in problems]

    return Tables(tables, problems)


def published() -> pa.Table:
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


class Answer(NamedTuple):
    """What one SELECT over the results returns.

    Attributes:
        rows: of the SELECT.
        problems: an error for each damaged record, which is left out.
        notes: sentences on names that the results have otherwise.
    """

    rows: pd.DataFrame
    problems: list[str]
    notes: list[str]


def query_results(results: Results, sql: str) -> Answer:
    """Runs one SELECT over the results; see `run_sql`."""
    # Arrow's own allocator releases and requests memory for each file, a third of the time.
    pa.set_memory_pool(pa.system_memory_pool())
    # Only tables whose names occur in the SQL are read. If the SQL builds a name, DuckDB does not
    # find the table, and all tables are read.
    tables, problems = load(results, named_tables(sql) or set(schema.TABLES), coded=True)
    try:
        rows = _select(sql, tables)
    except duckdb.CatalogException:
        tables, problems = load(results, coded=True)
        rows = run_sql(sql, tables)
    except duckdb.Error as error:
        raise _refusal(error, schema.TABLES, sql) from None

    return Answer(rows, problems, _notes_on_names(sql, tables))


def _notes_on_names(sql: str, tables: Mapping[str, pa.Table]) -> list[str]:
    """Returns a sentence for each representation that the SQL calls by the name that reports show.

    Reports show planar12 as planar, and SQL compares texts, so that 'planar' is found nowhere. A
    text in SQL with the column `kind` may be a kind, which has this name.
    """
    texts = set(re.findall(r"'([^']*)'", sql))
    columns = set(re.findall(r"\w+", sql.lower())) & {"representation", "kind"}
    if not texts or columns != {"representation"}:
        return []

    recorded: set[str] = set()
    for table in tables.values():
        if "representation" in table.column_names:
            recorded.update(filter(None, table["representation"].unique().to_pylist()))

    notes = []
    for text in sorted(texts - recorded):
        meant = sorted(name for name in recorded if shown_representation(name) == text)
        if meant:
            names_in_sql = ", ".join(f"'{name}'" for name in meant)
            notes.append(
                f"No run has the representation '{text}': SQL has whole names. Type "
                f"representation IN ({names_in_sql})."
            )

    return notes


def named_tables(sql: str) -> set[str]:
    """Returns the tables whose names occur in the SQL."""
    return set(re.findall(r"\w+", sql.lower())) & set(schema.TABLES)


def run_sql(sql: str, tables: Mapping[str, pa.Table]) -> pd.DataFrame:
    """Runs one SELECT, without access to files or network; raises a RequestError for any error."""
    try:
        return _select(sql, tables)
    except duckdb.Error as error:
        raise _refusal(error, tables, sql) from None


def _select(sql: str, tables: Mapping[str, pa.Table]) -> pd.DataFrame:
    """Runs one SELECT, which Ctrl-C interrupts."""
    # DuckDB handles Ctrl-C only at some points and turns it into its own errors. It therefore runs
    # in another thread, and this one receives Ctrl-C.
    # No spilling to files in the working directory; no files, network and extensions, permanently.
    limits = {"temp_directory": "", "enable_external_access": False, "lock_configuration": True}
    config: Any = {"python_enable_replacements": False, **limits}
    connection = duckdb.connect(":memory:", config=config)
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
    """Returns the rows of a SELECT on some tables."""
    for name, rows in tables.items():
        connection.register(name, rows)

    statements = connection.extract_statements(sql)
    if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
        raise RequestError("A query is one SELECT statement; the results are read-only.")

    connection.execute(statements[0])
    frame = connection.df()
    # Integers and dates that DuckDB turns into floats and times are such again.
    for i, type in enumerate(str(column[1]) for column in connection.description or ()):
        column = frame.iloc[:, i]
        # A sum of integers; from 2^53 on, floats are not exact and stay floats.
        if type == "HUGEINT" and (column.isna() | (column.abs() < 2**53)).all():
            frame.isetitem(i, column.astype("Int64").array)
        elif type == "DATE":
            with contextlib.suppress(ValueError):  # Python has no dates after the year 9999
                frame.isetitem(i, column.dt.date)

    return frame


def _refusal(error: duckdb.Error, tables: Iterable[str], sql: str) -> RequestError:
    """Returns DuckDB's message with the names that the user may have meant."""
    message, *more = str(error).splitlines()
    for line in more:
        if line.startswith("Candidate bindings"):
            # DuckDB misses columns that share a word with the missing one, such as steps.
            missing = re.search(r'column "(\w+)" not found', message)
            words = set(missing[1].lower().split("_")) if missing else set()
            columns = {name for table in named_tables(sql) for name in schema.TABLES[table].names}
            near = [f'"{name}"' for name in sorted(columns) if words & set(name.split("_"))]
            message += (
                f" The nearest columns: {', '.join([*near, line.partition(':')[2].strip(': ')])}. "
                "DESCRIBE with a table lists its columns; text is in single quotes, such as 'td3'."
            )
        elif line.startswith(("Did you mean", "Either add")):
            message += f" {line}"

    return RequestError(f"{message} (tables: {', '.join(sorted(tables))}).")


def to_csv(frame: pd.DataFrame) -> str:
    """Returns the rows as CSV with a header; no text of it is a formula of a spreadsheet."""
    frame = frame.copy(deep=False)
    for i, dtype in enumerate(frame.dtypes):
        if not pd.api.types.is_numeric_dtype(dtype):
            frame.isetitem(i, frame.iloc[:, i].map(not_formula).array)
    return frame.to_csv(index=False, lineterminator="\n")


def records(frame: pd.DataFrame) -> list[dict[Any, Any]]:
    """Returns the rows as dictionaries; missing values are None."""
    return frame.astype(object).where(frame.notna(), None).to_dict("records")


def _read(fields: Mapping[str, pa.Schema], record: Record) -> tuple[Row, dict[str, pa.Table]] | str:
    """Returns the row and the tables of a record, or the error of a damaged one."""
    try:
        return record.reading(
            lambda: (make_row(record), {n: _rows(record, n, some) for n, some in fields.items()})
        )
    except WorkError as error:
        return str(error)


def _rows(record: Record, name: str, columns: pa.Schema) -> pa.Table:
    """Returns columns of a record's table, those included that no file has."""
    if schema.KEPT not in columns.names:
        return record.read(name, columns)
    return with_kept(record, record.read(name)).select(columns.names).cast(columns)


def _selected_columns(table: str, names: Sequence[str] | None, coded: bool) -> pa.Schema:
    """Returns columns of a table, by default all; ids are dictionaries if `coded`."""
    columns = schema.TABLES[table]
    if coded:
        key = columns.field(0)
        columns = columns.set(0, key.with_type(pa.dictionary(pa.int32(), key.type)))
    return pa.schema([columns.field(name) for name in names or columns.names])
