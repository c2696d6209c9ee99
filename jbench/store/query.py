"""SQL over the results: DuckDB as a lens over the committed rows, owning no data."""

import csv
import io
import json
from collections.abc import Callable
from importlib import resources
from typing import Any, NamedTuple

import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa

from jbench.errors import RequestError, WorkError
from jbench.names import FULL
from jbench.store import schema
from jbench.store.database import Record, Results
from jbench.store.identity import settings_hash
from jbench.store.manifest import Kind


class Tables(NamedTuple):
    """Every table of a results directory, and a sentence for each part that can't be read."""

    tables: dict[str, pa.Table]
    problems: list[str]


def variant(settings: dict[str, Any]) -> str:
    """Returns the hash of a run's settings but seed and steps: of what its seeds share."""
    return settings_hash({k: v for k, v in settings.items() if k not in ("seed", "steps")})


def load(results: Results) -> Tables:
    """Reads and checks all tables of a results directory; a damaged record is left out whole."""
    tables: dict[str, list[pa.Table]] = {}
    problems: list[str] = []
    for kind, table, describe, schemas in _KINDS:
        columns_of_kind = getattr(schema, table.upper())
        records, unreadable = results.scan(kind)
        problems += unreadable
        rows = []
        for record in records:
            try:
                parts = {name: record.read(name, columns) for name, columns in schemas.items()}
                row = _row(record, describe, columns_of_kind)
            except WorkError as error:
                problems.append(str(error))
                continue
            rows.append(row)
            for name, part in parts.items():
                tables.setdefault(name, []).append(part)
        tables[table] = [columns_of_kind.empty_table(), *rows]
    tables["published"] = [published()]
    empty = {name: columns for *_, schemas in _KINDS for name, columns in schemas.items()}
    return Tables(
        {
            **{name: columns.empty_table() for name, columns in empty.items()},
            **{name: pa.concat_tables(parts) for name, parts in tables.items() if parts},
        },
        problems,
    )


def published() -> pa.Table:
    """Returns the paper's learning curves, its full-16 and dae-12 under our names `full`, `dae12`.

    The curve of SAC on a sequence of robots keeps a name of its own. The medians of fig8 come
    twice, with two pairs of bands (fig8 and fig8-10-90): choose by `figure`.
    """
    source = resources.files("jbench.experiments").joinpath("published_curves.csv").read_bytes()
    rows = pd.read_csv(io.BytesIO(source))
    names = rows["representation"].str.replace(r"^full-\d+", FULL, regex=True)
    rows["representation"] = names.str.replace("dae-", "dae", regex=False)
    return pa.Table.from_pandas(rows, schema.PUBLISHED, preserve_index=False, nthreads=1)


def run_sql(sql: str, tables: dict[str, pa.Table]) -> pd.DataFrame:
    """Returns the answer of one SELECT over the tables, without access to anything else.

    Raises:
        RequestError: if it is not one SELECT, or DuckDB refuses it.
    """
    connection = duckdb.connect(":memory:", config={"python_enable_replacements": False})
    try:
        for name, rows in tables.items():
            connection.register(name, rows)
        # From here on no file, no network and no extension, and no way to turn them on again.
        connection.execute("SET enable_external_access = false")
        connection.execute("SET lock_configuration = true")
        statements = connection.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise RequestError("A query is one SELECT statement; the results are read-only.")
        return connection.execute(statements[0]).df()
    except duckdb.Error as error:
        message = str(error).splitlines()[0]
        raise RequestError(f"{message} (tables: {', '.join(sorted(tables))}).") from None
    finally:
        connection.close()


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


def _row(
    record: Record, describe: Callable[[Record], dict[str, Any]], columns: pa.Schema
) -> pa.Table:
    """Returns the row of a record; its manifest may come from a stranger and say anything."""
    try:
        return pa.Table.from_pylist([describe(record)], columns)
    except (pa.ArrowException, OverflowError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise WorkError(
            f"The {record.kind} {record.id} has settings that can't be ({reason}); delete "
            f"{record.path} to make it anew."
        ) from None


def _run_row(record: Record) -> dict[str, Any]:
    settings = record.settings
    return {
        "run": record.id,
        **{
            name: settings.get(name)
            for name in ("task", "algo", "representation", "encoder", "seed", "steps")
        },
        "engine": settings.get("engine"),
        "time_limit": settings.get("time_limit"),
        "variant": variant(settings),
        "episodes": record.rows("episodes"),
        "wall_time": record.manifest.summary.get("wall_time"),
        **_common_row(record),
    }


def _encoder_row(record: Record) -> dict[str, Any]:
    settings, summary = record.settings, record.manifest.summary
    return {
        "encoder": record.id,
        "representation": f"{settings.get('kind')}{settings.get('latents')}",
        **{name: settings.get(name) for name in ("task", "latents", "seed", "dataset")},
        "test_mse": summary.get("test_mse"),
        "wall_time": summary.get("wall_time"),
        **_common_row(record),
    }


def _evaluation_row(record: Record) -> dict[str, Any]:
    settings, summary = record.settings, record.manifest.summary
    return {
        "evaluation": record.id,
        **{name: settings.get(name) for name in ("task", "policy", "seed", "episodes")},
        **{name: summary.get(name) for name in ("median", "q10", "q90")},
        **_common_row(record),
    }


def _dataset_row(record: Record) -> dict[str, Any]:
    return {
        "dataset": record.id,
        "seed": record.settings.get("seed"),
        "steps": record.settings.get("steps"),
        # A committed episode has a state more than it has steps.
        "steps_done": record.rows("steps") - record.rows("dataset_episodes"),
        "bytes": sum(entry.bytes for entry in record.manifest.files),
        **_common_row(record),
    }


def _common_row(record: Record) -> dict[str, Any]:
    manifest = record.manifest
    return {
        "status": manifest.status,
        "created": manifest.created,
        "updated": manifest.updated,
        "settings": json.dumps(manifest.settings, sort_keys=True),
        "provenance": json.dumps(manifest.provenance, sort_keys=True),
    }


_KINDS: tuple[tuple[Kind, str, Callable[[Record], dict[str, Any]], dict[str, pa.Schema]], ...] = (
    ("run", "runs", _run_row, {"episodes": schema.EPISODES, "evaluations": schema.EVALUATIONS}),
    (
        "encoder",
        "encoders",
        _encoder_row,
        {"encoder_epochs": schema.ENCODER_EPOCHS, "encoder_features": schema.ENCODER_FEATURES},
    ),
    (
        "evaluation",
        "policy_evaluations",
        _evaluation_row,
        {"policy_episodes": schema.POLICY_EPISODES},
    ),
    ("dataset", "datasets", _dataset_row, {}),
)
