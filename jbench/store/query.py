"""SQL over the committed rows with DuckDB."""

import contextlib
import re
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import Any, NamedTuple

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.errors import RequestError
from jbench.representation_names import shown_representation
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.tables import read_tables
from jbench.wording import not_formula

_TEXT = r"'(?:[^']|'')*'"
"""A text in SQL."""

_REPRESENTATIONS = re.compile(
    rf"""\brepresentation"?\s*(?:=|==|!=|<>|(?:NOT\s+)?IN\s*\()\s*(?P<after>(?:{_TEXT}[\s,]*)+)"""
    rf"""|(?P<before>{_TEXT})\s*(?:=|==|!=|<>)\s*(?:\w+\.)?"?representation\b""",
    re.IGNORECASE,
)
"""Texts that SQL compares with a representation: `= 'full'`, `IN ('full', 'dae12')`."""


class Answer(NamedTuple):
    """What one SELECT over the results returns.

    Attributes:
        rows: of the SELECT.
        problems: an error for each damaged record, which is left out.
        notes: sentences on representations that no row has.
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
    tables, problems = read_tables(results, named_tables(sql) or set(schema.TABLES), coded=True)
    try:
        rows = _select(sql, tables)
    except duckdb.CatalogException:
        tables, problems = read_tables(results, coded=True)
        rows = run_sql(sql, tables)
    except duckdb.Error as error:
        raise _refusal(error, schema.TABLES, sql) from None

    return Answer(rows, problems, _notes_on_names(sql, tables))


def _notes_on_names(sql: str, tables: Mapping[str, pa.Table]) -> list[str]:
    """Returns a sentence for each representation in the SQL that no row of the tables has.

    SQL compares whole names: reports show planar12 as planar, and 'planar' is found nowhere.
    """
    recorded: set[str] = set()
    for table in tables.values():
        if "representation" in table.column_names:
            recorded.update(filter(None, table["representation"].unique().to_pylist()))

    if not recorded:
        return []

    notes = []
    for text in sorted(_representations_in(sql) - recorded):
        unknown = f"No row has the representation '{text}'"
        meant = sorted(name for name in recorded if shown_representation(name) == text)
        if meant:
            names_in_sql = ", ".join(f"'{name}'" for name in meant)
            notes.append(
                f"{unknown}: SQL has whole names. Type representation IN ({names_in_sql})."
            )
        else:
            notes.append(f"{unknown}; there are {', '.join(sorted(recorded))}.")

    return notes


def _representations_in(sql: str) -> set[str]:
    """Returns the texts with which the SQL compares the column `representation`."""
    compared = (match["after"] or match["before"] for match in _REPRESENTATIONS.finditer(sql))
    texts = chain.from_iterable(re.findall(_TEXT, each) for each in compared)
    return {text[1:-1].replace("''", "'") for text in texts}


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
    missing = re.search(r'column (?:named )?"(\w+)"', message)
    advice = _advice_on_join(missing[1], sql) if missing else ""
    if advice:
        return RequestError(f"{message.rstrip('!')}; {advice}.")

    for line in more:
        if line.startswith("Candidate bindings"):
            # DuckDB misses columns that share a word with the missing one, such as steps.
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


def _advice_on_join(column: str, sql: str) -> str:
    """Returns which table has a column that those of the SQL lack, and how to join it; "" if none.

    It is the table of runs, encoders, datasets or imports, whose rows the others name.
    """
    named = named_tables(sql)
    columns = {name for table in named for name in schema.TABLES[table].names}
    for table in ("runs", "encoders", "datasets", "imports"):
        key = table.removesuffix("s")
        is_joined = key in columns and table not in named
        if is_joined and column in schema.TABLES[table].names:
            return f"{column} is a column of {table}: JOIN {table} USING ({key})"

    return ""


def to_csv(frame: pd.DataFrame) -> str:
    """Returns the rows as CSV with a header; no text of it is a formula of a spreadsheet."""
    frame = frame.copy(deep=False)
    for i, dtype in enumerate(frame.dtypes):
        if not pd.api.types.is_numeric_dtype(dtype):
            frame.isetitem(i, frame.iloc[:, i].map(_csv_cell).array)
    return frame.to_csv(index=False, lineterminator="\n")


def _csv_cell(value: Any) -> Any:
    """Returns a value for a CSV file, a list with all its elements; see `not_formula`."""
    if isinstance(value, np.ndarray):  # whose text leaves out the middle of a long one
        return str(value.tolist())
    return not_formula(value)


def records(frame: pd.DataFrame) -> list[dict[Any, Any]]:
    """Returns the rows as dictionaries; missing values are None."""
    return frame.astype(object).where(frame.notna(), None).to_dict("records")
