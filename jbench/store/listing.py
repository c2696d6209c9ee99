"""Rows and lines of records, from their manifests: what SQL and `jbench runs` see of them."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.returns import diverged_return, final_return, last_evaluation_return
from jbench.settings.code_words import code_dates, encoder_words
from jbench.settings.recorded import Run, Unreadable, read_run, recorded_episode_steps, variant
from jbench.settings.variants import variant_words
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.evaluations import added_returns, evaluation_returns
from jbench.store.files import DamagedError
from jbench.store.manifest import MANIFEST, Manifest, RecordKind
from jbench.store.record import Record
from jbench.store.roles import CHECKPOINT

ListedRow = dict[str, Any]
"""Values by column."""

_FINAL_RETURNS = ("last_return", "evaluation_return", "evaluation_return_at_end")
"""Columns of a line with returns, in which a run that diverged has its `diverged_return`."""

KIND_TABLES: dict[RecordKind, tuple[str, dict[str, pa.Schema]]] = {
    "run": ("runs", schema.RUN_TABLES),
    "encoder": ("encoders", schema.ENCODER_TABLES),
    "evaluation": ("policy_evaluations", {"policy_episodes": schema.TABLES["policy_episodes"]}),
    "dataset": ("datasets", {}),
    "import": ("imports", {"import_points": schema.TABLES["import_points"]}),
}
"""By kind, the table with a row for each record, and the tables that its files hold."""


def make_row(record: Record) -> ListedRow:
    """Returns the row of a record, with null for what its manifest lacks.

    Raises a DamagedError if a value of its manifest does not fit into its column.
    """
    manifest = record.manifest
    columns = schema.TABLES[KIND_TABLES[record.kind][0]]
    try:
        values = {
            **manifest.summary,
            **manifest.settings,
            **_counted(record),
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
    return float(value) if field.type == pa.float64() else value


def has_diverged(manifest: Manifest) -> bool:
    """Returns whether a run diverged; its manifest is untrusted."""
    return isinstance(manifest.summary.get("diverged"), dict)


def _counted(record: Record) -> ListedRow:
    """Returns the columns of a record's row that are specific to its kind."""
    manifest = record.manifest
    if record.kind == "run":
        text = None
        if has_diverged(manifest):
            text = json.dumps(manifest.summary["diverged"], sort_keys=True)
        counts = {"variant": variant(record.settings), "episodes": record.rows("episodes")}
        return {**counts, "diverged": text, "error": record.error}

    if record.kind == "encoder":
        return {"representation": record.path.parent.name}
    if record.kind == "dataset":
        # A committed episode has a state more than it has steps.
        steps = record.rows("steps") - record.rows("dataset_episodes")
        return {"steps_done": steps, "bytes": record.size}

    if record.kind == "import":
        hashes = record.settings.get("files")
        names = manifest.provenance.get("files")
        if isinstance(hashes, list) and isinstance(names, list):
            return {"files": json.dumps(dict(zip(hashes, names, strict=False)))}
        return {"files": "{}"}

    return {}


def list_runs(
    results: Results,
    filters: Mapping[str, Collection[Any]],
    returns: bool = False,
    kind: Literal["run", "import"] = "run",
) -> tuple[list[ListedRow], list[str]]:
    """Returns the lines of the runs, oldest first, and an error for each unreadable one.

    They are as by `make_line`, but `variant` names the settings in which the listed runs of the
    same algorithm and representation differ, as in legends. If `returns`, the episodes are read.
    The filters are the allowed values by field of a line.
    """
    records, problems = results.scan(kind)
    chosen: list[tuple[Record, ListedRow]] = []
    for record in records:
        try:
            if matches(line := make_line(record), filters):
                chosen.append((record, line))
        except WorkError as error:
            problems.append(str(error))

    added: dict[str, list[NDArray[np.float64]]] = {}
    if returns and kind == "run":
        added, unread = added_returns(results, {record.id: record.settings for record, _ in chosen})
        problems += unread

    lines: list[ListedRow] = []
    # By algorithm and representation, the settings of each variant.
    variants: dict[tuple[str, str], dict[str, Run]] = {}
    for record, line in chosen:
        try:
            read = partial(line_with_returns, record, added.get(record.id, ()))
            lines.append(line := record.reading(read) if returns else line)
        except WorkError as error:
            problems.append(str(error))
            continue

        run = read_run(record.settings)
        if not isinstance(run, Unreadable):
            variants.setdefault((line["algo"], line["representation"]), {})[line["variant"]] = run

    begun = ((read_run(record.settings), record.manifest.created) for record, _ in chosen)
    dates = code_dates(begun)
    has_encoders = any(record.settings.get("encoder") for record, _ in chosen)
    trained = results.scan("encoder")[0] if has_encoders else []
    encoders = encoder_words((e.id, e.settings, e.manifest.created) for e in trained)
    words = {names: variant_words(runs, dates, encoders) for names, runs in variants.items()}
    for line in lines:
        named = words.get((line["algo"], line["representation"]), {})
        line["variant"] = ", ".join(named.get(line["variant"], ()))

    return lines, problems


def committed_steps(record: Record) -> int:
    """Returns the control steps of a run up to its last commit.

    They are those of its newest checkpoint. Without one they follow from the number of episodes,
    as if none had ended before its time limit.
    """
    saved = [int(match[1]) for role in record.roles() if (match := CHECKPOINT.fullmatch(role))]
    if saved:
        return max(saved)
    made = record.rows("episodes") * recorded_episode_steps(record.settings)
    planned = record.settings.get("steps")
    return min(made, planned) if isinstance(planned, int) else made


def _recorded_steps(record: Record) -> int:
    """Returns the control steps of a run that rows are of.

    A run that failed has rows of the episodes after its newest checkpoint, too.
    """
    if record.status != "failed" or not record.rows("episodes"):
        return committed_steps(record)
    last: int = record.read("episodes")["control_steps"][-1].as_py()
    return last


def make_line(record: Record) -> ListedRow:
    """Returns the line of a run or an import; null is what is unknown.

    Its fields are columns of the table `runs` and: `steps_done`, control steps of the committed
    episodes, or of the finished run; `returns`, the kind of return of an import, whose points are
    its `episodes`; `error`, why a failed run failed; and, null until they are read, the final
    returns `last_return`, that of training or of an import's kind, `evaluation_return`, with the
    episodes of `jbench evaluate` that have joined the last evaluation, and
    `evaluation_return_at_end`, without them. Raises as `make_row`.
    """
    row = make_row(record)
    is_import = record.kind == "import"
    episodes = (row["points"] or 0) if is_import else row["episodes"]
    done = record.manifest.summary.get("control_steps" if is_import else "steps_done")
    if not isinstance(done, int | float) or not math.isfinite(done):
        done = 0 if is_import else _recorded_steps(record)

    line = {
        "run": record.id,
        **{name: row[name] for name in ("task", "algo", "representation", "seed", "status")},
        "episodes": episodes,
        "steps_done": done,
        **{n: row.get(n) for n in ("steps", "wall_time", "created", "updated", "returns")},
        "error": record.error,
        "variant": row.get("variant"),
        **dict.fromkeys(_FINAL_RETURNS),
    }
    return finite(line)


def line_with_returns(record: Record, added: Sequence[NDArray[np.float64]]) -> ListedRow:
    """Returns the line of a record with its `_FINAL_RETURNS`; see `added_returns`.

    Raises as `make_row`, and a WorkError if rows can't be read: `Record.reading` tries again.
    """
    line = make_line(record)
    if record.kind == "import":
        points = record.read("import_points").to_pandas()
        returns = points.groupby("point")["episode_return"].mean().to_numpy(np.float64)
        if line["returns"] == "evaluation":
            line["last_return"] = final_return(returns, "evaluation")
            line["evaluation_return"] = line["last_return"]
            line["evaluation_return_at_end"] = line["last_return"]
        else:
            line["last_return"] = final_return(returns)

        return line

    rows = record.read("episodes")
    training = rows["episode_return"].to_numpy()
    if has_diverged(record.manifest):
        line.update(dict.fromkeys(_FINAL_RETURNS, diverged_return(training)))
    elif len(rows):
        line["last_return"] = final_return(training)
        for name, more in (("evaluation_return", added), ("evaluation_return_at_end", ())):
            line[name] = last_evaluation_return(*evaluation_returns(record, more))

    if len(rows) and line["wall_time"] is None:
        line["wall_time"] = rows["wall_time"][-1].as_py()

    return finite(line)


def finite(row: ListedRow) -> ListedRow:
    """Returns a row with null for numbers that are not finite, which JSON does not have."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in row.items()
    }


def matches(line: ListedRow, filters: Mapping[str, Collection[Any]]) -> bool:
    """Returns whether each field that is filtered has one of the allowed values."""
    return all(line[name] in values for name, values in filters.items())


def setting_values(results: Results, setting: str) -> set[str]:
    """Returns the text values of a setting, such as `algo`, in the readable runs and imports."""
    records = [*results.scan("run")[0], *results.scan("import")[0]]
    values = (record.settings.get(setting) for record in records)
    return {value for value in values if isinstance(value, str)}
