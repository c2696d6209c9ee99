"""Rows of records in the tables of SQL, from their manifests."""

import json
import math
from typing import Any

import pyarrow as pa

from jbench.names import POLICY_FILES
from jbench.settings.recorded import variant
from jbench.store import schema
from jbench.store.encoder_tables import ENCODER_TABLES
from jbench.store.files import DamagedError
from jbench.store.manifest import MANIFEST, Manifest, RecordKind
from jbench.store.record import Record

Row = dict[str, Any]
"""Values by column."""

KIND_TABLES: dict[RecordKind, tuple[str, dict[str, pa.Schema]]] = {
    "run": ("runs", schema.RUN_TABLES),
    "encoder": ("encoders", ENCODER_TABLES),
    "evaluation": ("policy_evaluations", {"policy_episodes": schema.TABLES["policy_episodes"]}),
    "dataset": ("datasets", {}),
    "import": ("imports", {"import_points": schema.TABLES["import_points"]}),
}
"""By kind, the table with a row for each record, and the tables that its files hold."""


def make_row(record: Record) -> Row:
    """Returns the row of a record, with null for what its manifest lacks.

    Raises a DamagedError if a value of its manifest does not fit into its column.
    """
    manifest = record.manifest
    columns = schema.TABLES[KIND_TABLES[record.kind][0]]
    try:
        values = {
            **manifest.summary,
            **manifest.settings,
            **_columns_of_kind(record),
            record.kind: record.id,
            **{name: getattr(manifest, name) for name in ("status", "created", "updated")},
            "settings": json.dumps(manifest.settings, sort_keys=True),
            "provenance": json.dumps(manifest.provenance, sort_keys=True),
        }
        return {field.name: _converted(values.get(field.name), field) for field in columns}
    except (OverflowError, TypeError, ValueError) as error:
        problem = f"has invalid settings ({str(error).splitlines()[0]})"
        raise DamagedError(record.path / MANIFEST, problem, record.advice) from None


def _converted(value: Any, field: pa.Field) -> Any:
    """Returns a value as that of a column; pyarrow's check would import pandas, for 0.3 s."""
    if value is None:
        return None
    kinds: Any = {pa.string(): str, pa.int64(): int, pa.float64(): (int, float)}[field.type]
    if isinstance(value, bool) or not isinstance(value, kinds):
        raise TypeError(f"{field.name} is {value!r:.40}")
    if field.type == pa.float64():
        return float(value)
    return value


def has_diverged(manifest: Manifest) -> bool:
    """Returns whether a run diverged; its manifest is untrusted."""
    return isinstance(manifest.summary.get("diverged"), dict)


def has_policy(record: Record) -> bool:
    """Returns whether a run was saved with its policy; most shipped runs were not."""
    return {*POLICY_FILES} <= {entry.name for entry in record.manifest.files}


def _collected_steps(dataset: Record) -> int:
    """Returns the committed control steps of a dataset of any robot.

    An episode has a state more than it has steps. The Jitterbug's are in the tables `steps` and
    `dataset_episodes`, those of other robots in `observations` and `seeds`.
    """
    states = dataset.rows("steps") + dataset.rows("observations")
    episodes = dataset.rows("dataset_episodes") + dataset.rows("seeds")
    return states - episodes


def _columns_of_kind(record: Record) -> Row:
    """Returns the columns that the rows of a record's kind have beside those of all records."""
    manifest = record.manifest
    if record.kind == "run":
        diverged = None
        if has_diverged(manifest):
            diverged = json.dumps(manifest.summary["diverged"], sort_keys=True)
        return {
            "variant": variant(record.settings),
            "episodes": record.rows("episodes"),
            "diverged": diverged,
            "error": record.error,
        }

    if record.kind == "encoder":
        return {"representation": record.path.parent.name}
    if record.kind == "dataset":
        return {"steps_done": _collected_steps(record), "bytes": record.size}

    if record.kind == "import":
        hashes = record.settings.get("files")
        names = manifest.provenance.get("files")
        if isinstance(hashes, list) and isinstance(names, list):
            return {"files": json.dumps(dict(zip(hashes, names, strict=False)))}
        return {"files": "{}"}

    return {}


def finite(row: Row) -> Row:
    """Returns a row with null for numbers that are not finite, which JSON does not have."""
    finite_row = dict(row)
    for name, value in row.items():
        if isinstance(value, float) and not math.isfinite(value):
            finite_row[name] = None

    return finite_row
