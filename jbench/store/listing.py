"""Lists of runs and imported curves, and what is listed of all of them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.settings.code_words import code_dates, encoder_words
from jbench.settings.defaults import foreign_differences
from jbench.settings.recorded import Run, Unreadable, read_run
from jbench.settings.variants import variant_words
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.evaluations import added_returns
from jbench.store.record import Record
from jbench.store.rows import Row
from jbench.store.run_line import RunLine, line_with_returns, make_line


def list_runs(
    results: Results,
    filters: Mapping[str, Collection[Any]],
    returns: bool = False,
    kind: Literal["run", "import"] = "run",
) -> tuple[list[RunLine], list[str]]:
    """Returns the lines of the runs, oldest first, and an error for each unreadable one.

    Args:
        results: whose runs are listed.
        filters: the allowed values by field of a line.
        returns: whether to read the episodes, for the final returns.
        kind: runs or imported curves.
    """
    records, problems = results.scan(kind)
    chosen: list[tuple[Record, RunLine]] = []
    for record in records:
        try:
            line = make_line(record)
        except WorkError as error:
            problems.append(str(error))
            continue

        if line.matches(filters):
            chosen.append((record, line))

    records = [record for record, _ in chosen]
    if returns:
        added: dict[str, list[NDArray[np.float64]]] = {}
        if kind == "run":
            added, unread = added_returns(
                results, {record.id: record.settings for record in records}
            )
            problems += unread

        listed = []
        for record, _ in chosen:
            try:
                read = partial(line_with_returns, record, added.get(record.id, ()))
                listed.append((record, record.reading(read)))
            except WorkError as error:
                problems.append(str(error))

        chosen = listed

    return _with_variants_in_words(results, records, chosen), problems


def _with_variants_in_words(
    results: Results, records: Sequence[Record], listed: Sequence[tuple[Record, RunLine]]
) -> list[RunLine]:
    """Returns lines whose variants are the settings in which they differ.

    Args:
        results: that have the encoders of the runs.
        records: all that were chosen, from whose code `code_dates` are.
        listed: those that could be read, with their lines.
    """
    # By algorithm and representation, the settings of each variant.
    variants: dict[tuple[str | None, str | None], dict[str, Run]] = {}
    for record, line in listed:
        run = read_run(record.settings)
        if not isinstance(run, Unreadable):
            alike = variants.setdefault((line.algo, line.representation), {})
            alike[str(line.variant)] = run

    dates = code_dates((read_run(record.settings), record.manifest.created) for record in records)
    has_encoders = any(record.settings.get("encoder") for record in records)
    trained = list[Record]()
    if has_encoders:
        trained, _ = results.scan("encoder")

    encoders = encoder_words(
        (encoder.id, encoder.settings, encoder.manifest.created) for encoder in trained
    )
    all_runs = chain.from_iterable(runs.values() for runs in variants.values())
    foreign = foreign_differences(all_runs)
    words = {
        names: variant_words(runs, dates, encoders, foreign.get(str(names[0]), ()))
        for names, runs in variants.items()
    }

    lines = []
    for _, line in listed:
        named = words.get((line.algo, line.representation), {})
        text = ", ".join(named.get(str(line.variant), ()))
        lines.append(replace(line, variant=text))

    return lines


def final_returns(results: Results) -> tuple[pa.Table, list[str]]:
    """Returns the table `final_returns`: a row for each run; and an error for each unreadable one.

    A run that diverged has its `diverged_return`.
    """
    records, problems = results.scan("run")
    added, unread = added_returns(results, {record.id: record.settings for record in records})
    problems = [*problems, *unread]
    rows: list[Row] = []
    for record in records:
        try:
            line = record.reading(partial(line_with_returns, record, added.get(record.id, ())))
        except WorkError as error:
            problems.append(str(error))
            continue

        rows.append({**vars(line), "training_return": line.last_return})

    return pa.Table.from_pylist(rows, schema.TABLES["final_returns"]), problems


def setting_values(results: Results, setting: str) -> set[str]:
    """Returns the text values of a setting, such as `algo`, in the readable runs and imports."""
    records = [*results.scan("run")[0], *results.scan("import")[0]]
    values = (record.settings.get(setting) for record in records)
    return {value for value in values if isinstance(value, str)}
