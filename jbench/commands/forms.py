"""The JSON schemas of documents and of files: what `jbench schema` prints."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from jbench.commands.documents import (
    Algorithms,
    Archive,
    Check,
    Datasets,
    Doctor,
    Document,
    DryRun,
    Encoders,
    Error,
    ExportCroissant,
    ExportCurves,
    ExportDataset,
    ExportPolicy,
    Import,
    Leaderboard,
    Merge,
    RecordDocument,
    Render,
    Repair,
    Report,
    Reproduce,
    Runs,
    Schemas,
    Sweep,
    Tasks,
    Train,
    UntilDecided,
    Verify,
)
from jbench.settings.algorithms import SETTINGS
from jbench.settings.records import (
    DatasetSettings,
    EvaluationSettings,
    ExternalSettings,
    ImportSettings,
)
from jbench.settings.run import RunSettings
from jbench.store.manifest import Manifest
from jbench.studies.entries import Entry
from jbench.studies.matrix import COMPARISON, PART, Matrix

DOCUMENTS: Mapping[str, type[Document]] = {
    "error": Error,
    "algorithms": Algorithms,
    "archive": Archive,
    "check": Check,
    "collect": RecordDocument,
    "datasets": Datasets,
    "doctor": Doctor,
    "evaluate": RecordDocument,
    "export-croissant": ExportCroissant,
    "export-curves": ExportCurves,
    "export-dataset": ExportDataset,
    "export-policy": ExportPolicy,
    "import": Import,
    "leaderboard": Leaderboard,
    "merge": Merge,
    "render": Render,
    "repair": Repair,
    "report": Report,
    "reproduce": Reproduce,
    "runs": Runs,
    "schema": Schemas,
    "sweep": Sweep,
    "sweep-until-decided": UntilDecided,
    "tasks": Tasks,
    "train": Train,
    "train-dry-run": DryRun,
    "train-encoder": Encoders,
    "verify": Verify,
}
"""The document of each command that prints one; `query` and `tail` print rows of tables."""

FILES: Mapping[str, type[BaseModel]] = {
    "manifest": Manifest,
    "matrix": Matrix,
    "settings-run": RunSettings,
    "settings-recording": ExternalSettings,
    "settings-dataset": DatasetSettings,
    "settings-evaluation": EvaluationSettings,
    "settings-import": ImportSettings,
    **{f"hyperparameters-{algo}": kind for algo, kind in SETTINGS.items()},
}
"""The files that jbench reads and writes, and the settings in them."""


def schema_of(name: str) -> dict[str, Any]:
    """Returns the JSON schema of a document or of a file, one of `DOCUMENTS` and `FILES`."""
    if name == "matrix":
        schema = _matrix_file()
    else:
        schema = {**DOCUMENTS, **FILES}[name].model_json_schema()

    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _matrix_file() -> dict[str, Any]:
    """Returns the schema of a matrix: keys that hold for all parts, and what each part adds."""
    _, schemas = models_json_schema([(Matrix, "validation"), (Entry, "validation")])
    definitions: dict[str, Any] = schemas["$defs"]
    matrix = definitions.pop("Matrix")
    # Each key may stand above the parts or in them.
    del matrix["required"]
    part = {**matrix, "title": "Part"}
    entries = {"type": "array", "items": {"$ref": "#/$defs/Entry"}}
    arrays = {PART: {"type": "array", "items": part}, COMPARISON: entries}
    return {**matrix, "properties": {**matrix["properties"], **arrays}, "$defs": definitions}
