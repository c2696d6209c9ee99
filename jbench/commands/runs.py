"""The command runs: a list of runs, or of imported learning curves."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from typer import Option

from jbench import names
from jbench.commands import options, output, parsing
from jbench.errors import RequestError
from jbench.numbers import whole
from jbench.wording import counted, duration, progress_text, repair_hint

if TYPE_CHECKING:
    from jbench.store.run_line import RunLine

_SPARE = ("created", "wall time", "returns", "episodes", "points", "steps", "status", "variant")
"""Columns that `runs` leaves out on a narrow terminal, the first one first."""

_Listed = Literal["run", "import"]

_POINTS: Mapping[_Listed, str] = {"run": "episodes", "import": "points"}
"""Column of the number of points of a curve."""

_AT_END = "at the end of training"


def runs(
    task: str | None = options.ONE_TASK,
    algo: str | None = options.ONE_ALGORITHM,
    representation: str | None = options.ONE_REPRESENTATION,
    status: names.Status | None = options.ONE_STATUS,
    seed: str | None = options.SOME_SEEDS,
    returns: bool = Option(
        False,
        "--returns",
        help="Show final returns, of training and of the last evaluation; quote the latter.",
    ),
    failed: bool = Option(False, "--failed", help="List the runs that failed, with their errors."),
    policies: bool = Option(
        False,
        "--policies",
        help="Only runs whose policy was saved; evaluate, render and export take it.",
    ),
    imports: bool = Option(False, "--imports", help="List imported learning curves, not runs."),
    results: Path = options.READ_RESULTS,
    json: bool = options.JSON,
) -> None:
    """List runs with their status, progress and wall time.

    The oldest run comes first.
    """
    from jbench.store.listing import list_runs

    database = parsing.results_to_read(results)
    typed = {"task": task, "algo": algo, "representation": representation}
    if failed and status not in (None, "failed"):
        raise RequestError(f"--failed and --status {status} exclude each other; type one of them.")

    if policies and imports:
        raise RequestError("--imports and --policies exclude each other: imports have no policy.")

    if failed:
        status = "failed"
    kind: _Listed = "run"
    if imports:
        kind = "import"

    filters = parsing.run_filters(database, seed, status, **typed)
    if policies:
        filters["has_policy"] = [True]
    lines, problems = list_runs(database, filters, returns, kind)
    rows = [_cells(line, kind) for line in lines]
    if all(line.evaluation_return == line.evaluation_return_at_end for line in lines):
        for row in rows:
            del row[_AT_END]

    if rows:
        header = [name for name in rows[0] if any(row[name] not in (None, "") for row in rows)]
        cells = [[row[name] for name in header] for row in rows]
        output.table(counted(len(rows), kind), header, cells, _SPARE, below=("error",))
    else:
        wanted = f"such {kind}s" if filters else f"{kind}s"
        output.say(f"No {wanted} in {results}.")
        if kind == "run" and list_runs(database, filters, kind="import")[0]:
            output.say("There are imported curves, which --imports lists.")

    output.document({f"{kind}s": [asdict(line) for line in lines], "problems": problems})
    output.warn_of_damage(problems, repair_hint(results))


def _cells(line: "RunLine", kind: _Listed) -> dict[str, str | None]:
    """Returns the cells of a row of the table by their columns; None where a line has no value."""
    training_return = None
    if line.returns != "evaluation":
        training_return = _mean(line.last_return)

    return {
        kind: line.run,
        "status": line.status,
        _POINTS[kind]: f"{line.episodes:,}",
        "steps": progress_text(line.steps_done, line.steps),
        "wall time": None if line.wall_time is None else duration(line.wall_time),
        "created": line.created[:16].replace("T", " "),
        "returns": line.returns,
        "variant": line.variant,
        "error": line.error,
        "training return": training_return,
        "evaluation return": _mean(line.evaluation_return),
        _AT_END: _mean(line.evaluation_return_at_end),
    }


def _mean(value: float | None) -> str | None:
    """Returns a mean return as text, if there is one."""
    return None if value is None else whole(value)
