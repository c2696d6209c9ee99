"""What SQL sees of a record: its row, from its manifest, and the tables of its files."""

import json
from collections.abc import Callable
from typing import Any, NamedTuple

import pyarrow as pa

from jbench.settings.alike import variant
from jbench.store import encoder_schema, schema
from jbench.store.flaws import DamagedError
from jbench.store.manifest import MANIFEST, Kind
from jbench.store.record import Record

Row = dict[str, Any]
"""Values by column."""


class KindTables(NamedTuple):
    """The tables of a kind of records.

    Attributes:
        records_table: name of the table that has a row for each record.
        describe: returns the values of that row that neither settings nor summary contain.
        file_tables: columns of the tables that the files of a record hold.
    """

    records_table: str
    describe: Callable[[Record], Row]
    file_tables: dict[str, pa.Schema]


def make_row(record: Record) -> Row:
    """Returns the row of a record, with null for what its manifest lacks.

    Raises:
        DamagedError: if a value of its manifest does not fit into its column.
    """
    table, describe, _ = KINDS[record.kind]
    manifest = record.manifest
    try:
        values = {
            **manifest.summary,
            **manifest.settings,
            **describe(record),
            record.kind: record.id,
            "status": manifest.status,
            "created": manifest.created,
            "updated": manifest.updated,
            "settings": json.dumps(manifest.settings, sort_keys=True),
            "provenance": json.dumps(manifest.provenance, sort_keys=True),
        }
        row = {name: values.get(name) for name in schema.TABLES[table].names}
        for field in schema.TABLES[table]:
            pa.scalar(row[field.name], field.type)
    except (pa.ArrowException, OverflowError, TypeError, ValueError) as error:
        problem = f"has invalid settings ({str(error).splitlines()[0]})"
        raise DamagedError(record.path / MANIFEST, problem, record.advice) from None
    return row


def _describe_run(record: Record) -> Row:
    diverged = record.manifest.summary.get("diverged")
    return {
        "variant": variant(record.settings),
        "episodes": record.rows("episodes"),
        "diverged": json.dumps(diverged, sort_keys=True) if isinstance(diverged, dict) else None,
    }


def _describe_encoder(record: Record) -> Row:
    return {"representation": record.path.parent.name}


def _describe_dataset(record: Record) -> Row:
    return {
        # A committed episode has a state more than it has steps.
        "steps_done": record.rows("steps") - record.rows("dataset_episodes"),
        "bytes": record.size,
    }


def _describe_import(record: Record) -> Row:
    hashes, names = record.settings.get("files"), record.manifest.provenance.get("files")
    files = {}
    if isinstance(hashes, list) and isinstance(names, list):
        files = dict(zip(hashes, names, strict=False))
    return {"files": json.dumps(files)}


KINDS: dict[Kind, KindTables] = {
    "run": KindTables("runs", _describe_run, schema.RUN_TABLES),
    "encoder": KindTables("encoders", _describe_encoder, encoder_schema.ENCODER_TABLES),
    "evaluation": KindTables(
        "policy_evaluations", lambda record: {}, {"policy_episodes": schema.POLICY_EPISODES}
    ),
    "dataset": KindTables("datasets", _describe_dataset, {}),
    "import": KindTables("imports", _describe_import, {"import_points": schema.IMPORT_POINTS}),
}
"""The tables of each kind of records."""
