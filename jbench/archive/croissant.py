"""Croissant metadata (MLCommons) of a results directory or of a dataset, beside its tables.

Each table is one Parquet file, and one record set with the same columns; the responsible-AI fields
say what docs/datasheet.md says at length.
"""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from jbench.errors import RequestError, WorkError
from jbench.store import Record, Results, files, schema
from jbench.store.tables import read_tables
from jbench.wording import directory_name

METADATA = "metadata.json"

LICENSE = "https://creativecommons.org/licenses/by/4.0/"

_PAPERS_TABLE = "published"  # whose source is the paper

_CITE = (
    "The jbench developers. jbench: the Jitterbug problem as a benchmark. 2026. Augot, Snoswell, "
    "Singh: A Reduced-Order Approach to Assist with Reinforcement Learning for Underactuated "
    "Robotics. ACRA 2020."
)

_RESPONSIBLE = {
    "data_collection": "Simulated with MuJoCo: actions of a random policy, or the training and "
    "evaluation of agents with the settings that each record has.",
    "data_biases": "Random actions seldom move the robot far, so states of fast or directed motion "
    "are rare. Most runs are shorter than the paper's.",
    "data_limitations": "The model idealizes contacts, friction and motor; nothing predicts a real "
    "robot. Returns are equal bit for bit only on the same kind of processor.",
    "data_use_cases": "Comparing learning curves over seeds; training encoders; offline "
    "reinforcement learning.",
    "personal_sensitive_information": "None: everything is simulated.",
    "data_release_maintenance_plan": "Each release names the numbers that have changed; old "
    "records stay readable.",
}


def write_croissant(results: Results, out: Path, dataset: Record | None = None) -> list[Path]:
    """Writes the tables of results, or of a dataset of them, and their metadata; returns the files.

    Raises:
        RequestError: if there are no rows, or `out` is not writable.
        WorkError: if a record is damaged.
    """
    files.make_directory(out, "--out")
    if dataset is None:
        name = directory_name(results.name)
        tables = _tables_of(results)
    else:
        name = dataset.id.replace("/", "-")
        tables = _tables_of_dataset(dataset)

    written = []
    for table, rows in tables.items():
        path = out / f"{table}.parquet"
        sink = pa.BufferOutputStream()
        pq.write_table(rows, sink, compression="zstd")
        files.write_atomic(path, sink.getvalue().to_pybytes())
        written.append(path)

    if not written:
        raise RequestError(f"{results.name} has no rows; train or collect first.")

    metadata = _metadata(name, tables, {path.stem: path for path in written})
    files.write_atomic(out / METADATA, metadata)
    return [*written, out / METADATA]


def _tables_of(results: Results) -> dict[str, pa.Table]:
    """Returns the tables of results that have rows; a record that can't be read is a WorkError."""
    tables, problems = read_tables(results)
    if problems:
        raise WorkError(problems[0])
    return {name: rows for name, rows in tables.items() if rows.num_rows and name != _PAPERS_TABLE}


def _tables_of_dataset(dataset: Record) -> dict[str, pa.Table]:
    """Returns all rows of the tables of a dataset."""
    names = dict.fromkeys(entry.table for entry in dataset.manifest.files if entry.table)
    return {name: pa.concat_tables(_parts(dataset, name)) for name in names}


def _parts(dataset: Record, table: str) -> Iterator[pa.Table]:
    """Yields the rows of each file of a table of a dataset."""
    return (dataset.read_part(entry) for entry in dataset.parts(table))


def _metadata(name: str, tables: dict[str, pa.Table], paths: dict[str, Path]) -> bytes:
    """Returns the JSON-LD, after mlcroissant has validated it."""
    import mlcroissant as croissant

    distribution = [
        croissant.FileObject(
            id=path.name,
            name=path.name,
            content_url=path.name,
            encoding_formats=["application/x-parquet"],
            sha256=files.sha256(path.read_bytes()),
        )
        for path in paths.values()
    ]
    metadata = croissant.Metadata(
        name=name,
        description="Results of jbench: runs, encoders, evaluations and datasets on the Jitterbug "
        "tasks and other robots.",
        cite_as=_CITE,
        license=[LICENSE],
        url="https://pypi.org/project/jbench/",
        version="1.0.0",
        date_published=datetime.now(UTC),
        distribution=distribution,
        record_sets=[_record_set(table, rows, croissant) for table, rows in tables.items()],
        **_RESPONSIBLE,
    )
    if metadata.issues.errors:
        raise WorkError(f"The metadata are invalid: {metadata.issues.report()}")

    return (json.dumps(metadata.to_json(), indent=1, default=str) + "\n").encode()


def _record_set(table: str, rows: pa.Table, croissant: Any) -> Any:
    """Returns the description of a table: its columns with their units and types."""
    fields = []
    for column in rows.schema:
        unit = (column.metadata or {}).get(b"unit", b"").decode()
        source = croissant.Source(
            file_object=f"{table}.parquet", extract=croissant.Extract(column=column.name)
        )
        fields.append(
            croissant.Field(
                id=f"{table}/{column.name}",
                name=f"{table}/{column.name}",
                description=unit or column.name,
                data_types=[_data_type(column.type, croissant)],
                source=source,
            )
        )

    description = "a table of a dataset"
    if table in schema.TABLES:
        description = "a table of jbench query"
    return croissant.RecordSet(id=table, name=table, description=description, fields=fields)


def _data_type(kind: pa.DataType, croissant: Any) -> Any:
    """Returns the type of a column in the words of schema.org."""
    if pa.types.is_boolean(kind):
        return croissant.DataType.BOOL
    if pa.types.is_integer(kind):
        return croissant.DataType.INTEGER
    if pa.types.is_floating(kind):
        return croissant.DataType.FLOAT
    return croissant.DataType.TEXT
