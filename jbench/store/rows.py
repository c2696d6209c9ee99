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
        describe: makes that row.
        of_files: columns of the tables that the files of a record hold.
    """

    of_records: str
    describe: Callable[[Record], Row]
    of_files: dict[str, pa.Schema]


def row_of(record: Record) -> Row:
    """Returns the row of a record.

    Raises:
        WorkError: if a value of its manifest does not fit into its column.
    """
    table, describe, _ = KINDS[record.kind]
    try:
        row = describe(record)
        for field in schema.TABLES[table]:
            pa.scalar(row[field.name], field.type)
    except (pa.ArrowException, OverflowError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise WorkError(
            f"The {record.kind} {record.id} has invalid settings ({reason}); delete "
            f"{record.path} to make it again."
        ) from None
    return row


def _run_row(record: Record) -> Row:
    settings = record.settings
    diverged = record.manifest.summary.get("diverged")
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
        **{name: record.manifest.summary.get(name) for name in ("wall_time", "processor_time")},
        "diverged": json.dumps(diverged, sort_keys=True) if isinstance(diverged, dict) else None,
        **_common_row(record),
    }


_OF_ENCODERS = ("test_mse", "test_explained", "effective_rank", "wall_time")


def _encoder_row(record: Record) -> Row:
    settings, summary = record.settings, record.manifest.summary
    return {
        "encoder": record.id,
        "representation": f"{settings.get('kind')}{settings.get('latents')}",
        **{name: settings.get(name) for name in ("task", "kind", "latents", "seed", "dataset")},
        **{name: summary.get(name) for name in _OF_ENCODERS},
        **_common_row(record),
    }


def _evaluation_row(record: Record) -> Row:
    settings, summary = record.settings, record.manifest.summary
    return {
        "evaluation": record.id,
        **{name: settings.get(name) for name in ("task", "policy", "seed", "episodes")},
        **{name: summary.get(name) for name in ("median", "q10", "q90")},
        **_common_row(record),
    }


def _import_row(record: Record) -> Row:
    settings, summary = record.settings, record.manifest.summary
    hashes, names = settings.get("files"), record.manifest.provenance.get("files")
    files = {}
    if isinstance(hashes, list) and isinstance(names, list):
        files = dict(zip(hashes, names, strict=False))
    return {
        "import": record.id,
        **{
            name: settings.get(name)
            for name in ("task", "algo", "representation", "seed", "format", "returns")
        },
        **{name: summary.get(name) for name in ("points", "control_steps")},
        "files": json.dumps(files),
        **_common_row(record),
    }


def _dataset_row(record: Record) -> Row:
    return {
        "dataset": record.id,
        "seed": record.settings.get("seed"),
        "steps": record.settings.get("steps"),
        # A committed episode has a state more than it has steps.
        "steps_done": record.rows("steps") - record.rows("dataset_episodes"),
        "bytes": sum(entry.bytes for entry in record.manifest.files),
        **_common_row(record),
    }


def _common_row(record: Record) -> Row:
    manifest = record.manifest
    return {
        "status": manifest.status,
        "created": manifest.created,
        "updated": manifest.updated,
        "settings": json.dumps(manifest.settings, sort_keys=True),
        "provenance": json.dumps(manifest.provenance, sort_keys=True),
    }


KINDS: dict[Kind, KindTables] = {
    "run": KindTables("runs", _run_row, schema.RUN_TABLES),
    "encoder": KindTables(
        "encoders",
        _encoder_row,
        {
            "encoder_epochs": encoder_schema.ENCODER_EPOCHS,
            "encoder_features": encoder_schema.ENCODER_FEATURES,
            "encoder_errors": encoder_schema.ENCODER_ERRORS,
            "encoder_predictions": encoder_schema.ENCODER_PREDICTIONS,
        },
    ),
    "evaluation": KindTables(
        "policy_evaluations", _evaluation_row, {"policy_episodes": schema.POLICY_EPISODES}
    ),
    "dataset": KindTables("datasets", _dataset_row, {}),
    "import": KindTables("imports", _import_row, {"import_points": schema.IMPORT_POINTS}),
}
"""The tables of each kind of records."""
