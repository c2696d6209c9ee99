"""`jbench.open`: a results directory as pandas data frames."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from jbench.names import RETURNS, Order, ReturnsName, known
from jbench.report.configurations import curve_points
from jbench.report.data import rows
from jbench.report.data.cells import of_kind
from jbench.report.data.returns import KINDS
from jbench.report.request import WINDOW, Request
from jbench.store import Results, query
from jbench.store.shipped import results_to_read


def open_results(path: Path | str = "results") -> "OpenedResults":
    """Opens a results directory to read.

    Args:
        path: of the directory; "reference" for the results shipped with jbench, unless there is a
            directory of that name.

    Raises:
        RequestError: if there is no such directory.
    """
    return OpenedResults(results_to_read(path))


class OpenedResults:
    """A results directory whose rows are read as pandas data frames.

    Damaged records are left out, each with a `UserWarning`.
    """

    def __init__(self, results: Results) -> None:
        """Opens a results directory."""
        self._results = results

    def __repr__(self) -> str:
        """Returns the call that opens it."""
        return f"jbench.open({str(self._results.name)!r})"

    def query(self, sql: str) -> pd.DataFrame:
        """Returns the rows of one SELECT, as `jbench query` does; docs/database.md has the tables.

        Raises:
            RequestError: if it is not one SELECT, or DuckDB reports an error.
        """
        answer = query.query_results(self._results, sql)
        _warn(answer.problems)
        return answer.rows

    def curves(
        self,
        task: str | None = None,
        algo: str | None = None,
        returns: ReturnsName = "evaluation",
        window: int = WINDOW,
        order: Order = "quantile-first",
    ) -> pd.DataFrame:
        """Returns the learning curves that `jbench report` draws, as quantiles across seeds.

        Args:
            task: only this task.
            algo: only this algorithm.
            returns: "evaluation" or "training".
            window: episodes in a moving average of training returns.
            order: see `jbench.names.ORDERS`.

        Returns:
            A row for each point of each curve: task, algo, representation, variant, source,
            returns, order, window, control_steps, seeds, q10, q25, q50, q75, q90.

        Raises:
            RequestError: if an argument is invalid, or there are no such runs.
        """
        known("kind of returns", returns, RETURNS)
        request = Request(task=task, algo=algo, returns=returns, window=window, order=order)
        found = rows.joined(rows.own_and_imported(self._results, request))
        _warn(found.problems)
        cells = of_kind(found.cells, KINDS[returns])
        return curve_points([(cell, cell.curve(order, window)) for cell in cells])


def _warn(problems: Sequence[str]) -> None:
    for problem in problems:
        warnings.warn(problem, stacklevel=3)
