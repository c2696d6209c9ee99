"""What SQL sees of a record: its row, from its manifest, and the tables of its files."""

import json
from typing import Any

import pyarrow as pa

from jbench.settings.alike import variant
from jbench.store import encoder_schema, schema
from jbench.store.flaws import DamagedError
from jbench.store.manifest import MANIFEST, Kind
from jbench.store.record import Record

Row = dict[str, Any]
"""Values by column."""

KIND_TABLES: dict[Kind, tuple[str, dict[str, pa.Schema]]] = {
    "run": ("runs", schema.RUN_TABLES),
    "encoder": ("encoders", encoder_schema.ENCODER_TABLES),
    "evaluation": ("policy_evaluations", {"policy_episodes": schema.POLICY_EPISODES}),
    "dataset": ("datasets", {}),
    "import": ("imports", {"import_points": schema.IMPORT_POINTS}),
}
"""By kind, the table with a row for each record, and the tables that its files hold."""


def make_row(record: Record) -> Row:
    """Returns the row of a record, with null for what its manifest lacks.

    Raises a DamagedError if a value of its manifest does not fit into its column.
    """
    manifest, columns = record.manifest, schema.TABLES[KIND_TABLES[record.kind][0]]
    try:
        values = {
            **manifest.summary,
            **manifest.settings,
            **_counted(record),
            record.kind: record.id,
            "status": manifest.status,
            "created": manifest.created,
            "updated": manifest.updated,
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
    return float(value) if field.type == pa.float64() else value


def _counted(record: Record) -> Row:
    manifest = record.manifest
    if record.kind == "run":
        diverged = manifest.summary.get("diverged")
        return {
            "variant": variant(record.settings),
            "episodes": record.rows("episodes"),
            "diverged": json.dumps(diverged, sort_keys=True)
            if isinstance(diverged, dict)
            else None,
        }
    if record.kind == "encoder":
        return {"representation": record.path.parent.name}
    if record.kind == "dataset":
        # A committed episode has a state more than it has steps.
        steps = record.rows("steps") - record.rows("dataset_episodes")
        return {"steps_done": steps, "bytes": record.size}
    if record.kind == "import":
        hashes, names = record.settings.get("files"), manifest.provenance.get("files")
        if isinstance(hashes, list) and isinstance(names, list):
            return {"files": json.dumps(dict(zip(hashes, names, strict=False)))}
        return {"files": "{}"}
    return {}
