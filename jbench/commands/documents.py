"""The documents that `--json` prints, as pydantic models; `forms.py` has their schemas.

A document has the number of its form, `version`, which is incremented when a field goes or changes
its meaning; new fields may come at any time.
"""

from typing import Annotated, Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, create_model

from jbench.checks.checked import Checked
from jbench.importing.importer import Imported
from jbench.store.merge import Merged
from jbench.store.verify import Flaw
from jbench.training.repeated_rows import Repeated

JsonObject = dict[str, Any]
"""A row of a table; `jbench query "DESCRIBE runs"` and docs/database.md list its columns."""


_ACCEPTED = "checksum of the present code of task and encoder, if it is not the recorded one"


class Document(BaseModel):
    """What every document has."""

    model_config = ConfigDict(extra="forbid")

    version: Literal[1] = Field(1, description="of the form of the documents")


def _object(kind: type) -> WithJsonSchema:
    """Returns the schema of a named tuple, which a document has as an object."""
    strict = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
    fields: dict[str, Any] = {name: (hint, ...) for name, hint in get_type_hints(kind).items()}
    model = create_model(kind.__name__, __config__=strict, __doc__=kind.__doc__, **fields)
    return WithJsonSchema(model.model_json_schema())


class Error(Document):
    """Instead of any other document: what is wrong, and what to type instead."""

    error: str


class _Described(BaseModel):
    """A dataset, an encoder or an evaluation."""

    id: str
    path: str
    settings: JsonObject
    summary: JsonObject


class RecordEntry(_Described):
    """One of several records, with more about it."""

    model_config = ConfigDict(extra="allow")


class RecordDocument(_Described, Document):
    """`collect` and `evaluate`: the record that was made, or was there."""

    bytes: int | None = Field(None, description="of the files of a dataset")


class Datasets(Document):
    """`datasets`."""

    datasets: list[RecordEntry]
    problems: list[str]


class Encoders(Document):
    """`train-dae` and `train-encoder`."""

    encoders: list[RecordEntry]


class _Offered(Document):
    """What every list of offered code has."""

    broken: list[JsonObject] = Field(
        description="those whose package can't be used, with the reason"
    )


class Algorithms(_Offered):
    """`algorithms`."""

    algorithms: list[JsonObject]


class Tasks(_Offered):
    """`tasks`."""

    tasks: list[JsonObject]


class Runs(Document):
    """`runs`; with `--imports`, of imported curves."""

    runs: list[JsonObject] | None = None
    imports: list[JsonObject] | None = None
    problems: list[str]


class Leaderboard(Document):
    """`leaderboard`."""

    entries: list[JsonObject]
    problems: list[str]


class Train(Document):
    """`train`: the ids of all runs, of those that were left, and a sentence for each failed one."""

    runs: list[str]
    left: list[str]
    failures: dict[str, str]


class DryRun(Document):
    """`train --dry-run`: numbers of runs by status, and the seconds left."""

    configurations: list[JsonObject]
    seconds_left: float | None


class Sweep(Document):
    """`sweep`."""

    matrix: str
    configurations: list[JsonObject]
    seconds_left: float | None
    made_first: list[str] = Field(description="datasets and encoders")
    failures: dict[str, str]


class UntilDecided(Document):
    """`sweep --until-decided`."""

    matrix: str
    comparisons: list[JsonObject]
    needed: list[str] = Field(description="runs of the next analysis")
    failures: dict[str, str]


class Report(Document):
    """`report`."""

    headline: str
    configurations: list[JsonObject]
    verdicts: list[JsonObject]
    comparisons: list[JsonObject]
    claims: list[JsonObject] | None = None
    files: list[str]
    notes: list[str]
    problems: list[str]


class Verify(Document):
    """`verify`."""

    records: int
    files: int
    bytes: int
    findings: list[Annotated[Any, _object(Flaw)]]
    left_out: int = Field(description="runs whose policy is not in an installed package")
    other_code: list[dict[str, Any]] = Field(
        description="records whose code is not the present one"
    )
    reevaluations: list[Annotated[Any, _object(Repeated)]] | None = None


class Reproduce(Document):
    """`reproduce`: the last evaluation and the first training episodes, computed again."""

    run: str
    equal: bool
    evaluation: Annotated[Any, _object(Repeated)] | None
    training: Annotated[Any, _object(Repeated)] | None
    changed: dict[str, list[Any]] = Field(
        description="versions and processor that are not the recorded ones: both of each"
    )
    code: list[str] = Field(description="what has changed of the users' code of the run")


class Move(BaseModel):
    """A file that `repair` moved."""

    from_: str = Field(alias="from")
    to: str


class Repair(Document):
    """`repair`."""

    dry_run: bool
    moved: list[Move]
    left: list[str]
    commands: list[str]


class Merge(Document):
    """`merge`."""

    records: list[Annotated[Any, _object(Merged)]]


class Import(Document):
    """`import`."""

    imports: list[Annotated[Any, _object(Imported)]]


class Render(Document):
    """`render`."""

    path: str
    episode_return: float
    accepted: str | None = Field(description=_ACCEPTED)


class ExportPolicy(Document):
    """`export RUN`."""

    run: str
    task: str
    path: str
    bytes: int
    difference: float = Field(description="largest of the model's actions from the policy's")
    accepted: str | None = Field(description=_ACCEPTED)


class ExportDataset(Document):
    """`export --format minari`."""

    dataset: str
    task: str
    path: str
    minari_id: str


class ExportCroissant(Document):
    """`export --format croissant`."""

    path: str
    files: list[str]


class ExportCurves(Document):
    """`export --curves`."""

    path: str
    returns: str
    runs: int
    points: int


class Archive(Document):
    """`archive`."""

    path: str
    records: int
    bytes: int
    left_out: list[str] = Field(description="unfinished records")


class Doctor(Document):
    """`doctor`."""

    ok: bool
    checks: list[Annotated[Any, _object(Checked)]]


class Check(Document):
    """`check`."""

    name: str
    what: str
    ok: bool
    checks: list[Annotated[Any, _object(Checked)]]


class Schemas(Document):
    """`schema` without a name."""

    schemas: dict[str, JsonObject]
