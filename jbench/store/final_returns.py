"""The final returns of runs, as rows of the table `final_returns`."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from jbench.errors import WorkError
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.evaluations import added_returns
from jbench.store.listing import ListedRow, line_with_returns
from jbench.store.record import Record


def final_returns(results: Results) -> tuple[pa.Table, list[str]]:
    """Returns a row for each run, and an error for each that can't be read.

    A run that diverged has the `returns.diverged_return`.
    """
    records, problems = results.scan("run")
    added, unread = added_returns(results, {record.id: record.settings for record in records})
    problems = [*problems, *unread]
    rows: list[ListedRow] = []
    for record in records:
        try:
            rows.append(record.reading(partial(_row, record, added.get(record.id, ()))))
        except WorkError as error:
            problems.append(str(error))

    return pa.Table.from_pylist(rows, schema.TABLES["final_returns"]), problems


def _row(record: Record, added: Sequence[NDArray[np.float64]]) -> ListedRow:
    """Returns the row of a run; see `line_with_returns` for the arguments and errors."""
    line = line_with_returns(record, added)
    line["training_return"] = line["last_return"]
    return {name: line[name] for name in schema.TABLES["final_returns"].names}
