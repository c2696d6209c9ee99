"""The final returns of runs, as rows of the table `final_returns`."""

from functools import partial
from typing import Any

import pyarrow as pa

from jbench.errors import WorkError
from jbench.store import schema
from jbench.store.database import Results
from jbench.store.evaluations import added_returns
from jbench.store.listing import line_with_returns


def final_returns(results: Results) -> tuple[pa.Table, list[str]]:
    """Returns a row for each run, and an error for each that can't be read.

    A run that diverged has the return 0, as in a report.
    """
    records, problems = results.scan("run")
    added, unread = added_returns(results, {record.id: record.settings for record in records})
    problems = [*problems, *unread]
    rows: list[dict[str, Any]] = []
    for record in records:
        try:
            line = record.reading(partial(line_with_returns, record, added.get(record.id, ())))
        except WorkError as error:
            problems.append(str(error))
            continue

        returns = {
            "evaluation_return": line["evaluation_return"],
            "evaluation_return_at_end": line["evaluation_return_at_end"],
            "training_return": line["last_return"],
        }
        if isinstance(record.manifest.summary.get("diverged"), dict):
            returns = dict.fromkeys(returns, 0.0)
        others = {name: line[name] for name in ("run", "seed", "wall_time", "error")}
        rows.append({**others, **returns})

    return pa.Table.from_pylist(rows, schema.TABLES["final_returns"]), problems
