"""What SQL sees of a record: its row, from its manifest, and the tables of its files."""

import json
from collections.abc import Callable
from typing import Any, NamedTuple

import pyarrow as pa

from jbench.errors import WorkError
from jbench.settings.alike import variant
from jbench.store import encoder_schema, schema
from jbench.store.manifest import Kind
from jbench.store.record import Record

Row = dict[str, Any]
"""Values by column."""


class KindTables(NamedTuple):
    """The tables of a kind of records.

    Attributes:
        of_records: name of the table that has a row for each record.
        describe: returns the values of that row that neither settings nor summary contain.
        of_files: columns of the tables that the files of a record hold.
    """

    of_records: str
    describe: Callable[[Record], Row]
    of_files: dict[str, pa.Schema]


def row_of(record: Record) -> Row:
    """Returns the row of a record, with null for what its manifest lacks.

    Raises:
        WorkError: if a value of its manifest does not fit into its column.
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
        reason = str(error).splitlines()[0]
        raise WorkError(
            f"The {record.kind} {record.id} has invalid settings ({reason}); "
            f"{record.set_aside_hint}."
        ) from None
    return row


def _of_run(record: Record) -> Row:
    diverged = record.manifest.summary.get("diverged")
    return {
        "variant": variant(record.settings),
        "episodes": record.rows("episodes"),
        "diverged": json.dumps(diverged, sort_keys=True) if isinstance(diverged, dict) else None,
    }


def _of_encoder(record: Record) -> Row:
    return {"representation": record.path.parent.name}


def _of_dataset(record: Record) -> Row:
    return {
        # A committed episode has a state more than it has steps.
        "steps_done": record.rows("steps") - record.rows("dataset_episodes"),
        "bytes": record.size,
    }


def _of_import(record: Record) -> Row:
    hashes, names = record.settings.get("files"), record.manifest.provenance.get("files")
    files = {}
    if isinstance(hashes, list) and isinstance(names, list):
        files = dict(zip(hashes, names, strict=False))
    return {"files": json.dumps(files)}


KINDS: dict[Kind, KindTables] = {
    "run": KindTables("runs", _of_run, schema.RUN_TABLES),
    "encoder": KindTables("encoders", _of_encoder, encoder_schema.ENCODER_TABLES),
    "evaluation": KindTables(
        "policy_evaluations", lambda record: {}, {"policy_episodes": schema.POLICY_EPISODES}
    ),
    "dataset": KindTables("datasets", _of_dataset, {}),
    "import": KindTables("imports", _of_import, {"import_points": schema.IMPORT_POINTS}),
}
"""The tables of each kind of records."""
